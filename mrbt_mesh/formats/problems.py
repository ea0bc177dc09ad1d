"""The problems of a user's file, with file, line and path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from mrbt_mesh.errors import MAX_PATH_CHARACTERS, MAX_SHOWN_CHARACTERS, FileError, Problem

SourcePath: TypeAlias = tuple[str | int, ...]

MAX_PROBLEMS = 100


@dataclass
class Report:
    """Collects the problems of one file; `lines` maps paths inside the file to line numbers."""

    file: str
    lines: Mapping[SourcePath, int]
    _found: dict[Problem, None] = field(default_factory=dict)

    def add(self, path: SourcePath, message: str, line: int | None = None) -> None:
        """Note a problem, on the line of `path` unless another is given.

        A problem that several expansions lead to is noted once. Nothing is noted once `is_full`.
        """
        if not self.is_full:
            line = self.line(path) if line is None else line
            self._found[Problem(self.file, line, path_text(path), message)] = None

    @property
    def is_full(self) -> bool:
        """True if there are more problems than will be shown."""
        return len(self._found) > MAX_PROBLEMS

    def line(self, path: SourcePath) -> int:
        """Return the line of `path`, or of the nearest element that encloses it."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)

    def raise_if_any(self) -> None:
        """Raise FileError with the problems in the order of the file, at most 100."""
        if not self._found:
            return
        problems = sorted(list(self._found)[:MAX_PROBLEMS], key=lambda problem: problem.line)
        if self.is_full:
            problems.append(Problem(self.file, 0, "", "and more problems"))
        raise FileError(problems)


def path_text(path: SourcePath) -> str:
    """`("tree", "Sequence", 1, "Action")` -> `tree/Sequence[2]/Action`; items count from 1.

    The middle of a very long path is left out.
    """
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            text += f"/{part}" if text else part
    if len(text) > MAX_PATH_CHARACTERS:
        half = MAX_PATH_CHARACTERS // 2
        text = f"{text[:half]}...{text[-half:]}"
    return text


def found(value: Any) -> str:
    """Return a short text for a value in the file where something else is expected."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int) and value.bit_length() > 1_000:
        return "a number with hundreds of digits"  # Python writes none with thousands
    text = repr(value)
    if len(text) > MAX_SHOWN_CHARACTERS:
        text = text[:MAX_SHOWN_CHARACTERS] + "..."
    return f"the text {text}" if isinstance(value, str) else f"the number {text}"
