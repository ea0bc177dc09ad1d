"""How elements are written."""

from __future__ import annotations

from xml.sax.saxutils import escape, quoteattr

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.btcpp.files.elements import Element, Text, write_content

TEXTS = st.text(st.sampled_from("ab<>&'\"\n\r\t é"), max_size=8)


@given(TEXTS)
def test_attributes_and_texts_are_escaped_as_the_standard_library_does(text: str) -> None:
    assert write_content(Element("a", {"b": text})) == f"<a b={quoteattr(text)}/>"
    inner = write_content(Element("a", {}, [Text("x" + text)]))
    assert inner == f"<a>x{escape(text, {chr(13): '&#13;'})}</a>"
