"""Reading: random documents round trip, and no input gets anything but the reader's own error."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.analysis.team_tree import to_team_tree
from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import Document, parse_document, pointer, read_document
from mrbt_mesh.btcpp.files.elements import Comment, Content, Element, Instruction, Text
from mrbt_mesh.btcpp.files.export import explicit, with_ids
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from mrbt_mesh.btcpp.files.loadable import compact, loadable
from mrbt_mesh.btcpp.files.upgrade import upgrade
from mrbt_mesh.btcpp.files.xml_reader import MAX_BYTES, MAX_ITEMS, parse_xml, read_xml
from mrbt_mesh.errors import FileError, Problem
from mrbt_mesh.views.trees.drawing import render_mermaid
from mrbt_mesh.views.trees.shapes import file_shapes

FOLDER = Path(__file__).parent
FILES = sorted([*(FOLDER / "corpus").glob("**/*.xml"), *(FOLDER / "malformed").glob("*.xml")])

# What XML 1.0 allows.
CHARACTERS = st.characters(
    min_codepoint=32, exclude_categories=["Cs"], exclude_characters="\ufffe\uffff"
) | st.sampled_from("\t\n\r<>&\"'{}=;")
VALUES = st.text(CHARACTERS, max_size=12)
TAGS = st.sampled_from(["Sequence", "Action", "SubTree", "Foo", "größe", "a.b-c", "ns:tag", "_x"])
NAMES = st.sampled_from(["ID", "name", "port", "_skipIf", "_onSuccess", "ns:a", "größe", "a.b"])


def _no_double_dash(text: str) -> str:
    text = text.replace("\r", "")
    while "--" in text:
        text = text.replace("--", "-")
    return text.removesuffix("-")


COMMENTS = st.builds(Comment, VALUES.map(_no_double_dash))
INSTRUCTIONS = st.builds(
    Instruction,
    st.sampled_from(["keep", "style-sheet"]),
    VALUES.map(lambda text: text.replace("\r", "").replace("?", "").strip(" \t\n")),
)
TEXTS = st.builds(Text, VALUES.filter(lambda text: bool(text.strip(" \t\r\n"))))
ATTRIBUTES = st.dictionaries(NAMES, VALUES, max_size=4)


def _without_neighbouring_texts(content: list[Content]) -> list[Content]:
    return [
        item
        for number, item in enumerate(content)
        if not (isinstance(item, Text) and number and isinstance(content[number - 1], Text))
    ]


def _contents(elements: st.SearchStrategy[Element]) -> st.SearchStrategy[list[Content]]:
    items: st.SearchStrategy[Content] = elements | COMMENTS | INSTRUCTIONS | TEXTS
    return st.lists(items, max_size=4).map(_without_neighbouring_texts)


ELEMENTS = st.recursive(
    st.builds(Element, TAGS, ATTRIBUTES),
    lambda inner: st.builds(Element, TAGS, ATTRIBUTES, _contents(inner)),
    max_leaves=12,
)
AROUND = st.lists(COMMENTS | INSTRUCTIONS, max_size=2)
DOCUMENTS = st.builds(
    lambda before, attributes, content, after: Document(
        "random.xml", [*before, Element("root", attributes, content), *after]
    ),
    AROUND,
    ATTRIBUTES,
    _contents(ELEMENTS),
    AROUND,
)


@given(DOCUMENTS)
def test_random_documents_round_trip(document: Document) -> None:
    text = document.text()
    again = parse_document(text, "random.xml")
    assert again == document
    assert again.text() == text


@given(DOCUMENTS)
def test_a_copy_is_equal_and_apart(document: Document) -> None:
    copy = document.copy()
    assert copy == document
    copy.root.attributes["more"] = "1"
    assert copy != document


def use(content: bytes) -> None:
    """Do with a file what any command does; only the reader's own error may come of it."""
    for step in (_read_and_check, _convert):
        problems: list[Problem] = []
        try:
            step(content)
        except FileError as error:
            problems = error.problems
            message = str(error)
        else:
            message = "-"
        assert message
        assert all(problem.file == "fuzz.xml" for problem in problems)


def _read_and_check(content: bytes) -> None:
    document = parse_document(content, "fuzz.xml")
    assert parse_document(document.text(), "fuzz.xml") == document
    upgraded = upgrade(document, Findings())
    again = Findings()
    assert upgrade(upgraded, again) is upgraded
    assert not again.found
    for is_strict in (False, True):
        findings = Findings(is_strict)
        check_library(library_of(document, findings), findings)


def _convert(content: bytes) -> None:
    """Also of documents with errors: a tree is drawn, if it can be, whatever is wrong with it."""
    library = library_of(parse_document(content, "fuzz.xml"), Findings())
    render_mermaid(file_shapes(library))
    exported = explicit(library)
    assert parse_document(exported.text(), "fuzz.xml") == exported
    parse_document(compact(exported).text(), "fuzz.xml")
    assert loadable(exported) == loadable(loadable(exported))
    parse_document(loadable(exported).text(), "fuzz.xml")
    for tree in library.trees:
        to_team_tree(library, tree)
    with_ids(library)


@given(st.binary(max_size=300))
def test_arbitrary_bytes(content: bytes) -> None:
    use(content)


@given(st.text(max_size=300))
def test_arbitrary_text(content: str) -> None:
    use(content.encode("utf-8", "surrogatepass"))


@st.composite
def mutated_files(draw: st.DrawFn) -> bytes:
    """A file of the corpus with pieces cut, doubled, moved or overwritten."""
    content = draw(st.sampled_from(FILES)).read_bytes()[:4000]
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, max(len(content) - 1, 0)))
        end = min(len(content), start + draw(st.integers(0, 40)))
        piece = draw(
            st.binary(max_size=4)
            | st.sampled_from([b"<Sequence>", b'ID="', b"/>", b"&amp;", b"<!--", b"{}", b'"', b""])
            | st.just(content[start:end] * 2)
        )
        content = content[:start] + piece + content[end:]
    return content


@settings(max_examples=300)
@given(mutated_files())
def test_mutated_files(content: bytes) -> None:
    use(content)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_file_cut_anywhere(path: Path) -> None:
    content = path.read_bytes()[:1500]
    for length in range(0, len(content), 37):
        use(content[:length])


def test_lines_and_columns() -> None:
    text = '<root>\n  <!-- c -->\n  <BehaviorTree ID="A"><Foo\n    x="1"/></BehaviorTree>\n</root>'
    elements = list(parse_document(text, "a.xml").root.walk())
    assert [(e.tag, e.line, e.column) for e in elements] == [
        ("root", 1, 1),
        ("BehaviorTree", 3, 3),
        ("Foo", 3, 24),
    ]


def test_pointers() -> None:
    assert pointer("{a}") == pointer(" {a} ") == "a"
    assert pointer("{=}", "port") == pointer("=", "port") == "port"
    assert [pointer(text) for text in ("{}", "a", "{a", "", "=")] == [None] * 5


def test_size_limit(tmp_path: Path) -> None:
    path = tmp_path / "large.xml"
    path.write_bytes(b"<root>" + b" " * MAX_BYTES + b"</root>")
    with pytest.raises(FileError, match=f"larger than the limit of {MAX_BYTES} bytes"):
        read_xml(path)
    with pytest.raises(FileError, match="larger than the limit of 10 bytes"):
        read_xml(path, 10)


def test_element_limit() -> None:
    for item in (b"<a/>", b"<!---->", b"<?a?>"):
        with pytest.raises(FileError, match=f"more than {MAX_ITEMS} elements, comments"):
            parse_xml(b"<root>" + item * MAX_ITEMS + b"</root>", "a.xml")


def test_unreadable_files(tmp_path: Path) -> None:
    for path in (tmp_path / "none.xml", tmp_path):
        with pytest.raises(FileError):
            read_document(path)


def test_nothing_outside_the_file_is_opened(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("SECRET")
    text = f'<!DOCTYPE root [<!ENTITY s SYSTEM "{secret.as_uri()}">]><root>&s;</root>'
    with pytest.raises(FileError) as caught:
        parse_document(text, "a.xml")
    assert "SECRET" not in str(caught.value)
