"""Reads XML from a file that may be hostile, with the position of every element.

The parser is Expat. Document type declarations are refused as soon as they begin, so there are no
entities: nothing can expand, and no other file is ever opened. Invalid XML that BehaviorTree.CPP's
own reader (tinyxml2) accepts is read with a warning, and valid XML that it refuses is noted.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from mrbt_mesh.btcpp.files.elements import Comment, Content, Element, Instruction, Text
from mrbt_mesh.btcpp.files.lenient_xml import mended
from mrbt_mesh.errors import FileError, Problem, read_limited

MAX_BYTES = 8 << 20
# BehaviorTree.CPP allows 256 levels below <BehaviorTree>, which is at level 2.
MAX_LEVELS = 256 + 2
MAX_ITEMS = 100_000
MAX_ATTRIBUTES = 500
ENCODINGS = frozenset({"utf-8", "utf-16", "utf-16le", "utf-16be", "us-ascii", "iso-8859-1"})

_DECLARED = re.compile(rb"""<\?xml[^>]{0,200}?encoding\s*=\s*["']([\w-]+)""")
_BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_HINTS = {
    expat.errors.XML_ERROR_UNDEFINED_ENTITY: (
        "an undefined entity; only &amp; &lt; &gt; &quot; &apos; and &#...; are allowed"
    ),
    expat.errors.XML_ERROR_NO_ELEMENTS: "no element in it",
    expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT: "something follows the end of the root element",
    expat.errors.XML_ERROR_DUPLICATE_ATTRIBUTE: "an attribute is given twice",
}


@dataclass
class XmlContent:
    """The root element of a file, with the comments and instructions around it.

    `tolerated`: invalid XML that BehaviorTree.CPP reads. `refused`: valid XML that it refuses.
    """

    items: list[Content] = field(default_factory=list)
    tolerated: list[Problem] = field(default_factory=list)
    refused: list[Problem] = field(default_factory=list)


def read_xml(path: Path, limit_bytes: int = MAX_BYTES) -> XmlContent:
    """Read an XML file. Raises FileError, and nothing else."""
    return parse_xml(read_limited(path, limit_bytes), str(path))


def parse_xml(content: bytes | str, file: str) -> XmlContent:
    """Like `read_xml`, from memory; `file` is used in messages."""
    try:
        return _Reader(file).read(content)
    except FileError:
        text = content if isinstance(content, str) else _decoded(content)
        kept, raw = mended(text) if text is not None else ("", [])
        if not raw:
            raise
        found = _Reader(file, "utf-8").read(kept.encode(errors="replace"))
        found.tolerated += [Problem(file, line, "", message) for line, message in raw]
        return found


def _decoded(content: bytes) -> str | None:
    """Decode a file by its byte order mark or declaration; None if it cannot be decoded."""
    marked = (name for mark, name in _BYTE_ORDER_MARKS.items() if content.startswith(mark))
    declared = _DECLARED.match(content)
    encoding = next(marked, declared[1].decode() if declared else "utf-8")
    if encoding.lower() not in ENCODINGS | {"utf-8-sig"}:
        return None
    try:
        return content.decode(encoding)
    except UnicodeDecodeError:
        return None


class _Reader:
    def __init__(self, file: str, encoding: str | None = None) -> None:
        self.file = file
        self.found = XmlContent()
        self.open: list[Element] = []
        self.added = 0
        self.parser = parser = expat.ParserCreate(encoding)
        parser.buffer_text = True
        parser.ordered_attributes = True
        parser.XmlDeclHandler = self.declaration
        parser.StartDoctypeDeclHandler = self.doctype
        parser.EntityDeclHandler = self.entity
        parser.ExternalEntityRefHandler = self.external
        parser.StartElementHandler = self.start
        parser.EndElementHandler = self.end
        parser.CharacterDataHandler = self.characters
        parser.CommentHandler = self.comment
        parser.ProcessingInstructionHandler = self.instruction

    def read(self, content: bytes | str) -> XmlContent:
        if isinstance(content, bytes) and content[:2] in _BYTE_ORDER_MARKS:
            self.refuse(1, "BehaviorTree.CPP reads UTF-8 only, and this is UTF-16")
        try:
            self.parser.Parse(content, True)
        except expat.ExpatError as error:
            raise self.error(self.why(error), error.lineno) from None
        except (ValueError, LookupError) as error:
            raise self.error(f"not a text file in UTF-8: {error}") from None
        finally:
            # The handlers are bound methods of this reader: break the reference cycle.
            del self.parser
        return self.found

    def refuse(self, line: int, message: str) -> None:
        self.found.refused.append(Problem(self.file, line, "", message))

    def error(self, message: str, line: int = 0) -> FileError:
        path = "/".join(element.tag for element in self.open[:6])
        if len(self.open) > 6:
            path += "/..."
        line = line or self.parser.CurrentLineNumber
        return FileError([Problem(self.file, line, path, message)])

    def why(self, error: expat.ExpatError) -> str:
        text = expat.ErrorString(error.code)
        if text == expat.errors.XML_ERROR_TAG_MISMATCH and self.open:
            last = self.open[-1]
            text = f"a closing tag does not match <{last.tag}>, opened in line {last.line}"
        elif text == expat.errors.XML_ERROR_NO_ELEMENTS and self.open:
            last = self.open[-1]
            text = f"the file ends before <{last.tag}>, opened in line {last.line}, is closed"
        else:
            text = _HINTS.get(text, text)
        return f"not well-formed XML: {text} (column {error.offset + 1})"

    def declaration(self, version: str, encoding: str | None, standalone: int) -> None:
        if encoding is not None and encoding.lower() not in ENCODINGS:
            raise self.error(f"encoding {encoding!r} cannot be read; save the file as UTF-8")

    def doctype(self, *_: object) -> None:
        raise self.error("a document type declaration (<!DOCTYPE ...>) is not allowed; remove it")

    def entity(self, *_: object) -> None:
        raise self.error("entity declarations are not allowed; remove them")

    def external(self, *_: object) -> int:
        raise self.error("references to other files are not allowed; remove them")

    def start(self, tag: str, attributes: list[str]) -> None:
        element = Element(tag, dict(zip(attributes[::2], attributes[1::2], strict=True)))
        element.line = self.parser.CurrentLineNumber
        element.column = self.parser.CurrentColumnNumber + 1
        if len(self.open) >= MAX_LEVELS:
            raise self.error(f"nested deeper than {MAX_LEVELS} levels")
        if len(element.attributes) > MAX_ATTRIBUTES:
            raise self.error(f"<{tag}> has more than {MAX_ATTRIBUTES} attributes")
        self.add(element)
        self.open.append(element)

    def end(self, tag: str) -> None:
        self.open.pop()

    def characters(self, text: str) -> None:
        if text.strip(" \t\r\n"):
            self.add(Text(text))

    def comment(self, text: str) -> None:
        self.add(Comment(text))

    def instruction(self, target: str, data: str) -> None:
        if self.open or any(not isinstance(item, Instruction) for item in self.found.items):
            line = self.parser.CurrentLineNumber
            self.refuse(
                line, f"BehaviorTree.CPP reads <?{target} ...?> only as the first of a file"
            )
        self.add(Instruction(target, data))

    def add(self, item: Content) -> None:
        self.added += 1
        if self.added > MAX_ITEMS:
            raise self.error(f"more than {MAX_ITEMS} elements, comments and texts")
        (self.open[-1].content if self.open else self.found.items).append(item)
