"""Explain why a text is not YAML: the line to change, and how."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ruamel.yaml.error import MarkedYAMLError, StringMark, YAMLError

_UNSPACED_COLON = re.compile(r"\s*(?:- )?[\w$-]+:[^\s:/]")
_NO_START = re.compile(r"found character '(.+)' that cannot start any token")
_CLOSING = {"mapping": ("{", "}"), "sequence": ("[", "]")}


def explain_yaml(error: YAMLError, text: str) -> tuple[int, str]:
    """Return (line, what is wrong there and how to correct it); line 0 if not known."""
    lines = text.splitlines()
    if not isinstance(error, MarkedYAMLError):
        return _unreadable(error, text)
    problem, context = error.problem or "", error.context or ""
    at, begun = _line(error.problem_mark), _line(error.context_mark)
    for explain in (_character, _quote, _brackets, _indentation, _colon):
        found = explain(problem, context, (at, begun), lines)
        if found is not None:
            return found
    if "another document" in problem:
        return at, "a second document begins here (---); a file holds one"
    if problem.startswith("found undefined alias"):
        return at, f"{problem}; text that begins with * needs quotes"
    return at or begun, " ".join(f"{context} {problem}".split())


_Explained = tuple[int, str] | None


def _line(mark: StringMark | None) -> int:
    return 0 if mark is None else mark.line + 1


def _unreadable(error: YAMLError, text: str) -> tuple[int, str]:
    position, character = getattr(error, "position", None), getattr(error, "character", None)
    if isinstance(position, int) and isinstance(character, int):
        line = text.count("\n", 0, position) + 1
        return line, f"the control character U+{character:04X} is not allowed; remove it"
    return 0, " ".join(str(error).split())


def _character(problem: str, context: str, at: tuple[int, int], lines: Sequence[str]) -> _Explained:
    match = _NO_START.fullmatch(problem)
    if match is None:
        return None
    if match[1] in ("\\t", "\t"):
        return at[0], "this line is indented with a tab; use spaces"
    return at[0], f"text that begins with {match[1]} needs quotes"


def _quote(problem: str, context: str, at: tuple[int, int], lines: Sequence[str]) -> _Explained:
    if "quoted scalar" not in context:
        return None
    if "end of stream" in problem:
        return at[1], "the quote that opens here is never closed; add the closing quote"
    return at[0], f"in a quoted text: {problem}"


def _brackets(problem: str, context: str, at: tuple[int, int], lines: Sequence[str]) -> _Explained:
    match = re.search(r"flow (mapping|sequence)", context)
    if match is None:
        if found := re.search(r"but found '([]}])'", problem):
            return at[0], f"this {found[1]} closes nothing; remove it"
        return None
    opening, closing = _CLOSING[match[1]]
    if at[0] == at[1]:
        return at[0], f"a comma, or the closing {closing}, is missing in this line"
    return at[1], f"the {opening} that opens here is not closed; add {closing}"


def _indentation(
    problem: str, context: str, at: tuple[int, int], lines: Sequence[str]
) -> _Explained:
    if problem.startswith("expected '<document start>'") and "block mapping" in problem:
        return at[0], "the lines above are indented and this one is not; indent them alike"
    if not problem.startswith("expected <block end>"):
        return None
    if "'<scalar>'" in problem:
        text = "text follows a quoted text; put all of it in quotes, or close a quote further up"
        return at[0], text
    before = _line_before(at[0], lines)
    widths = [len(line) - len(line.lstrip(" ")) for line in (lines[at[0] - 1], lines[before - 1])]
    text = f"this line begins in column {widths[0] + 1}, line {before} in column {widths[1] + 1}"
    return at[0], f"{text}; indent what belongs together alike"


def _line_before(line: int, lines: Sequence[str]) -> int:
    """Return the last line before `line` that is not blank or only a comment; 0 if none."""
    texts = (lines[number - 1].strip() for number in range(line - 1, 0, -1))
    return next((line - n for n, t in enumerate(texts, 1) if t and not t.startswith("#")), 0)


def _colon(problem: str, context: str, at: tuple[int, int], lines: Sequence[str]) -> _Explained:
    if "could not find expected ':'" in problem:
        return at[1], "a colon is missing after this key, e.g. robots: ..."
    if "mapping values are not allowed" not in problem:
        return None
    before = _line_before(at[0], lines)
    if before and _UNSPACED_COLON.match(lines[before - 1]):
        return before, "a space is missing after the colon"
    if lines[at[0] - 1].count(": ") > 1:
        return at[0], "there is a second colon in this line; text with ': ' in it needs quotes"
    if before and re.match(r"\s*\w+ ", lines[before - 1]) and ":" not in lines[before - 1]:
        return before, "a colon is missing after the key, e.g. mission: explore"
    text = f"this line is indented as a part of line {before}, which already has a value"
    return at[0], f"{text}; correct the indentation"
