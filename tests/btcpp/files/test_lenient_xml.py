"""Raw characters: what is escaped, where that is said to be, and what hostile text costs."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.lenient_xml import mended

RAW = st.text("<>&;amp#1x ='ab\n", max_size=12)


@given(RAW, RAW.filter(lambda text: "<" not in text))
def test_any_text_comes_through(value: str, text: str) -> None:
    """What tinyxml2 makes of it: references are replaced, everything else is text."""
    kept, _ = mended(f'<root a="{value}">.{text}.</root>')
    found = ElementTree.fromstring(kept)
    references = {"&amp;": "&", "&#1;": "&#1;"}
    if not any(each in value + text for each in references) and "&#" not in value + text:
        assert found.get("a") == value.replace("\n", " ")
        assert found.text == f".{text}."


def test_well_formed_text_stays_as_it_is() -> None:
    text = """<?xml version="1.0"?><!-- a < b && c --><root a="&lt;&amp;&#10;" b='"'>
    <![CDATA[a && b]]> > &gt; </root>"""
    assert mended(text) == (text, [])


def test_lines_and_places() -> None:
    text = "<root>\n<a\n x=\"1 < 2\"\n y='a && b'/>\n  c & d\n</root>"
    kept, notes = mended(text)
    assert [line for line, _ in notes] == [3, 4, 5]
    assert [note.split(":")[0] for _, note in notes] == ["attribute 'x'", "attribute 'y'", "text"]
    assert mended(kept) == (kept, [])


def test_attributes_with_nothing_between_them() -> None:
    text = '<root>\n<a x="1"\n y=\'"z="\'_z="a<b"w=\'3\'/>\n</root>'
    kept, notes = mended(text)
    assert kept == '<root>\n<a x="1"\n y=\'"z="\' _z="a&lt;b" w=\'3\'/>\n</root>'
    assert [(line, note.split(":")[0]) for line, note in notes] == [
        (3, "attribute 'y'"),
        (3, "attribute '_z'"),
    ]
    assert mended(kept) == (kept, [])


def test_hyphens_in_comments() -> None:
    text = "<root>\n<!-- a -- b --->\n<!--->--\n<a/>--></root>"
    kept, notes = mended(text)
    assert kept == "<root>\n<!-- a - - b - -->\n<!--->- -\n<a/>--></root>"
    assert [(line, note.split(",")[0]) for line, note in notes] == [
        (2, "comment: '--'"),
        (3, "comment: '--'"),
    ]
    document = parse_document(text, "m.xml")
    assert parse_document(document.text(), "m.xml").tolerated == ()


def test_what_is_tolerated_is_told_with_its_line() -> None:
    document = parse_document('<root>\n<a x="1 < 2"/></root>', "m.xml")
    assert [(problem.file, problem.line) for problem in document.tolerated] == [("m.xml", 2)]
    assert document.root.children[0].get("x") == "1 < 2"
    assert parse_document(document.text(), "m.xml").tolerated == ()


def test_utf_16_and_latin_1_are_repaired_too() -> None:
    for encoding, declared in (("utf-16", "utf-16"), ("latin-1", "iso-8859-1")):
        text = f'<?xml version="1.0" encoding="{declared}"?><root a="ä < & b"/>'
        assert parse_document(text.encode(encoding), "m.xml").root.get("a") == "ä < & b"


@pytest.mark.parametrize("piece", ["<a ", '<a b="', "<!--", "<?", "<a b", '<a "\'"'])
def test_each_place_is_looked_at_a_few_times_only(piece: str) -> None:
    """A text of twice the length takes twice the time: here, none that would be noticed."""
    mended(piece * 100_000)
