"""The output of commands: styled text, tables, trees, frames, and their streams."""

from __future__ import annotations

import os
import re
import shutil
import sys
import unicodedata
from collections.abc import Container, Iterable, Iterator, Sequence
from typing import Protocol, TextIO, TypeAlias

# Terminal codes (ECMA-48).
_STYLES = {"bold": 1, "dim": 2, "red": 31, "green": 32, "yellow": 33, "blue": 34}
_STYLES |= {"magenta": 35, "cyan": 36}
# For pipes and files, and for terminals of unknown width.
_USUAL_WIDTH = 80
_NARROWEST = 8
_GAP = 2

# A text and its style, in words such as "bold red".
Span: TypeAlias = tuple[str, str]
Line: TypeAlias = list[Span]


class Renderable(Protocol):
    """Anything that can be printed as lines."""

    def lines(self, width: int | None) -> Iterator[Line]:
        """Yield the lines, wrapped at `width`; None: not wrapped."""


Printable: TypeAlias = "str | Renderable"


class Styled:
    """Pieces of text with a style each, wrapped between words unless `no_wrap`."""

    def __init__(self, text: str = "", style: str = "", *, no_wrap: bool = False) -> None:
        self.spans: Line = [(text, style)] if text else []
        self.no_wrap = no_wrap

    @classmethod
    def assemble(cls, *parts: str | Styled | Span) -> Styled:
        """Join several pieces; a pair is a text with its style."""
        found = cls()
        for part in parts:
            if isinstance(part, Styled):
                found.append_text(part)
            else:
                found.append(*((part,) if isinstance(part, str) else part))
        return found

    @property
    def plain(self) -> str:
        """The text without its styles."""
        return "".join(text for text, _ in self.spans)

    def append(self, text: str, style: str = "") -> Styled:
        """Add a piece. Returns this text."""
        if text:
            self.spans.append((text, style))
        return self

    def append_text(self, text: Styled) -> Styled:
        """Add all pieces of another text. Returns this one."""
        self.spans += text.spans
        return self

    def join(self, texts: Iterable[Styled]) -> Styled:
        """Join texts, with this one between them."""
        found = Styled()
        for number, text in enumerate(texts):
            found.append_text(self if number else Styled()).append_text(text)
        return found

    def lines(self, width: int | None) -> Iterator[Line]:
        lines: list[Line] = [[]]
        for text, style in self.spans:
            first, *others = text.split("\n")
            lines[-1].append((first, style))
            lines += ([(other, style)] for other in others)
        for line in lines:
            yield from [line] if width is None or self.no_wrap else _wrapped(line, width)


class Stack:
    """Several parts, one below the other."""

    def __init__(self, *parts: Printable) -> None:
        self._parts = parts

    def lines(self, width: int | None) -> Iterator[Line]:
        for part in self._parts:
            yield from as_lines(part, width)


class Table:
    """A table without rules. `right` are the columns of figures. The first column is not
    wrapped.
    """

    def __init__(
        self, headings: Sequence[str], right: Container[int] = (), first_style: str = ""
    ) -> None:
        self._rows: list[list[Styled]] = []
        self._right, self._first_style, self._count = right, first_style, len(headings)
        self._head = [Styled(heading, "dim") for heading in headings] if any(headings) else None

    @property
    def row_count(self) -> int:
        """The number of rows without the headings."""
        return len(self._rows)

    def add_row(self, *cells: str | Styled) -> None:
        """Add a row. Missing cells at its end are empty."""
        row = [Styled(cell) if isinstance(cell, str) else cell for cell in cells]
        row += [Styled() for _ in range(self._count - len(row))]
        if self._first_style:
            row[0] = Styled(row[0].plain, self._first_style)
        self._rows.append(row)

    def lines(self, width: int | None) -> Iterator[Line]:
        rows = [*([self._head] if self._head is not None else []), *self._rows]
        widths = self._widths(rows, width)
        for row in rows:
            cells = [
                list(cell.lines(None if number == 0 else widths[number]))
                for number, cell in enumerate(row)
            ]
            for height in range(max(map(len, cells))):
                line: Line = []
                for number, cell in enumerate(cells):
                    text = cell[height] if height < len(cell) else []
                    missing = (" " * max(0, widths[number] - _width(text)), "")
                    line += [missing, *text] if number in self._right else [*text, missing]
                    line.append((" " * _GAP, ""))
                yield _stripped(line)

    def _widths(self, rows: Sequence[Sequence[Styled]], width: int | None) -> list[int]:
        """Return the widths of the columns; if they exceed `width`, the widest columns shrink."""
        widths = [
            max((_width(line) for row in rows for line in row[number].lines(None)), default=0)
            for number in range(self._count)
        ]
        kept = {number for row in rows for number, cell in enumerate(row) if cell.no_wrap}
        may_shrink = [number for number in range(1, self._count) if number not in kept]
        while width is not None and sum(widths) + _GAP * (self._count - 1) > width:
            widest = max(may_shrink, key=widths.__getitem__, default=0)
            if widest == 0 or widths[widest] <= _NARROWEST:
                break
            widths[widest] -= 1
        return widths


class PrintedTree:
    """A label with branches below it."""

    def __init__(self, label: Styled) -> None:
        self._label = label
        self._branches: list[PrintedTree] = []

    def add(self, label: Styled) -> PrintedTree:
        """Add a branch and return it."""
        self._branches.append(PrintedTree(label))
        return self._branches[-1]

    def lines(self, width: int | None) -> Iterator[Line]:
        yield from self._label.lines(width)
        for branch in self._branches:
            is_last = branch is self._branches[-1]
            guides = ("└── ", "    ") if is_last else ("├── ", "│   ")
            below = None if width is None else max(_NARROWEST, width - len(guides[0]))
            for number, line in enumerate(branch.lines(below)):
                yield [(guides[min(number, 1)], "dim"), *line]


class Panel:
    """A framed text; the frame has a style."""

    def __init__(self, text: Styled, style: str) -> None:
        self._text, self._style = text, style

    def lines(self, width: int | None) -> Iterator[Line]:
        inner = list(self._text.lines(None if width is None else max(_NARROWEST, width - 4)))
        widest = max(map(_width, inner))
        yield [("╭" + "─" * (widest + 2) + "╮", self._style)]
        for line in inner:
            missing = " " * (widest - _width(line))
            yield [("│ ", self._style), *line, (f"{missing} ", ""), ("│", self._style)]
        yield [("╰" + "─" * (widest + 2) + "╯", self._style)]


class Console:
    """The current standard output or standard error."""

    def __init__(self, *, is_stderr: bool = False) -> None:
        self._is_stderr = is_stderr

    @property
    def stream(self) -> TextIO:
        return sys.stderr if self._is_stderr else sys.stdout

    @property
    def is_terminal(self) -> bool:
        return self.stream.isatty()

    def print(self, *parts: Printable, soft_wrap: bool = False) -> None:
        """Print parts one below the other; with `soft_wrap` the terminal wraps their lines."""
        width = None if soft_wrap else shutil.get_terminal_size((_USUAL_WIDTH, 24)).columns
        has_styles = self._has_styles()
        text = "".join(
            f"{_written(line, has_styles)}\n"
            for part in parts or [""]
            for line in as_lines(part, width)
        )
        self.stream.write(text)
        self.stream.flush()

    def _has_styles(self) -> bool:
        """Follow https://no-color.org and https://force-color.org."""
        if os.environ.get("NO_COLOR"):
            return False
        if os.environ.get("FORCE_COLOR"):
            return True
        return self.is_terminal and os.environ.get("TERM") not in ("dumb", "unknown")


def as_lines(part: Printable, width: int | None) -> Iterator[Line]:
    """Return the lines of anything printable, including plain text."""
    return (Styled(part) if isinstance(part, str) else part).lines(width)


def plain(part: Printable, width: int | None = None) -> str:
    """Return what is printed of a part, without styles."""
    return "".join(f"{_written(line, False)}\n" for line in as_lines(part, width))


def _written(line: Line, has_styles: bool) -> str:
    return "".join(_styled(text, style) if has_styles else text for text, style in line)


def _styled(text: str, style: str) -> str:
    codes = ";".join(str(_STYLES[word]) for word in style.split())
    return f"\x1b[{codes}m{text}\x1b[0m" if codes and text else text


def _width(line: Line) -> int:
    """Return the width in columns of a terminal."""
    return sum(_columns(text) for text, _ in line)


def _columns(text: str) -> int:
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(sign) else 1 + (unicodedata.east_asian_width(sign) in "WF")
        for sign in text
    )


def _stripped(line: Line) -> Line:
    """Strip spaces from the end of a line."""
    while line and not line[-1][0].rstrip(" "):
        line.pop()
    if line:
        line[-1] = (line[-1][0].rstrip(" "), line[-1][1])
    return line


def _wrapped(line: Line, width: int) -> Iterator[Line]:
    """Wrap a line between words, and inside words that are longer than a line."""
    if _width(line) <= width:
        yield line
        return
    room, found = width, list[Span]()
    for word in _words(line):
        if _width(_stripped([*word])) > room and found:
            yield _stripped(found)
            room, found = width, []
        for text, style in word:
            while _columns(text.rstrip()) > room:
                count = _fitting(text, room)
                found.append((text[:count], style))
                yield found
                room, found, text = width, [], text[count:]
            found.append((text, style))
            room -= _columns(text)
    if found:
        yield _stripped(found)


def _words(line: Line) -> Iterator[Line]:
    """Yield the words, each with the spaces after it; a word may have several styles."""
    word: Line = []
    for text, style in line:
        for piece in re.findall(r"\S+\s*|\s+", text):
            word.append((piece, style))
            if piece[-1].isspace():
                yield word
                word = []
    if word:
        yield word


def _fitting(text: str, room: int) -> int:
    """Return how many characters of a text fit, at least one."""
    count = 1
    while count < len(text) and _columns(text[: count + 1]) <= room:
        count += 1
    return count
