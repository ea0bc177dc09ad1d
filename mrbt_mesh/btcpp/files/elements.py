"""XML as data: elements with their positions in the file, and how they are written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

INDENT = "  "
MAX_WIDTH = 100

# xml.sax.saxutils does the same, but imports all of urllib.
_IN_TEXT = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", "\r": "&#13;"})
_IN_ATTRIBUTE = _IN_TEXT | str.maketrans({"\n": "&#10;", "\t": "&#9;"})


@dataclass(frozen=True, slots=True)
class Comment:
    """`<!--text-->`; XML allows no `--` in it."""

    text: str


@dataclass(frozen=True, slots=True)
class Text:
    """Text between tags that is not only white space."""

    text: str


@dataclass(frozen=True, slots=True)
class Instruction:
    """`<?target data?>`, for example a reference to a style sheet."""

    target: str
    data: str


@dataclass(slots=True, eq=False)
class Element:
    """One element; attributes keep their order. `line` and `column` count from 1; 0: unknown.

    Elements are equal if their tags, attributes and content are, in order. Positions are ignored.
    """

    tag: str
    attributes: dict[str, str] = field(default_factory=dict)
    content: list[Content] = field(default_factory=list)
    line: int = 0
    column: int = 0

    @property
    def children(self) -> list[Element]:
        """The child elements, without comments and texts."""
        return [item for item in self.content if isinstance(item, Element)]

    @property
    def text(self) -> str:
        """The element's own text, without that of child elements."""
        return "".join(item.text for item in self.content if isinstance(item, Text))

    def get(self, attribute: str, default: str = "") -> str:
        """Return an attribute's value, or `default` if it is missing."""
        return self.attributes.get(attribute, default)

    def walk(self) -> Iterator[Element]:
        """Yield this element and its descendants, parents first, in file order."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting.extend(reversed(element.children))

    def copy(self) -> Element:
        """Return a copy that shares no mutable data."""
        content = [item.copy() if isinstance(item, Element) else item for item in self.content]
        return Element(self.tag, dict(self.attributes), content, self.line, self.column)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Element):
            return NotImplemented
        return list(_flat(self)) == list(_flat(other))

    __hash__ = None  # type: ignore[assignment]


Content: TypeAlias = Element | Comment | Text | Instruction


def _flat(element: Element) -> Iterator[object]:
    """Yield the element as a flat sequence, so comparing deep elements needs no recursion."""
    waiting: list[object] = [element]
    while waiting:
        item = waiting.pop()
        if isinstance(item, Element):
            yield (item.tag, tuple(item.attributes.items()), len(item.content))
            waiting.extend(reversed(item.content))
        else:
            yield item


def write_content(item: Content, indent: str = "") -> str:
    """Return one item as XML on lines of its own; an element with text is not indented inside."""
    if not isinstance(item, Element):
        return indent + _inline(item)
    if not item.content:
        return _open_tag(item, "/>", indent)
    if any(isinstance(inner, Text) for inner in item.content):
        return indent + _inline(item)
    inner = "\n".join(write_content(inner, indent + INDENT) for inner in item.content)
    return f"{_open_tag(item, '>', indent)}\n{inner}\n{indent}</{item.tag}>"


def _quoted(value: str) -> str:
    """Quote an attribute's value, with single quotes if it contains only double ones."""
    escaped = value.translate(_IN_ATTRIBUTE)
    if '"' not in escaped:
        return f'"{escaped}"'
    return "'" + escaped + "'" if "'" not in escaped else '"' + escaped.replace('"', "&quot;") + '"'


def _open_tag(element: Element, end: str, indent: str) -> str:
    """Return a tag on one line, or with one attribute per line if it would be too long."""
    attributes = [f"{name}={_quoted(value)}" for name, value in element.attributes.items()]
    line = indent + " ".join([f"<{element.tag}", *attributes]) + end
    if len(line) <= MAX_WIDTH or len(attributes) < 2:
        return line
    between = "\n" + indent + " " * (len(element.tag) + 2)
    return f"{indent}<{element.tag} {between.join(attributes)}{end}"


def _inline(item: Content) -> str:
    if isinstance(item, Text):
        return item.text.translate(_IN_TEXT)
    if isinstance(item, Comment):
        return f"<!--{item.text}-->"
    if isinstance(item, Instruction):
        return f"<?{item.target} {item.data}?>" if item.data else f"<?{item.target}?>"
    if not item.content:
        return _open_tag(item, "/>", "")
    return f"{_open_tag(item, '>', '')}{''.join(map(_inline, item.content))}</{item.tag}>"
