"""Readers of values from the network: each accepts only its own kind, else raises ValueError."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Any

MAX_TEXT = 640
MAX_STAMP = (1 << 53) - 1
MAX_DATA_DEPTH = 16


def shown(value: Any) -> str:
    """A short text for a value that may be huge, or nested too deeply for `repr`."""
    return reprlib.repr(value)[:60]


def read_text(value: Any, limit: int = MAX_TEXT) -> str:
    """Read a text, and make it one line that is safe to show."""
    return printable(read_document(value, limit))


def printable(text: str) -> str:
    """Replace each character that a terminal might obey or not show by `?`."""
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() else "?" for sign in text)


def read_document(value: Any, limit: int) -> str:
    """Read a text as it is, with all its lines."""
    if not isinstance(value, str) or len(value) > limit:
        raise ValueError(f"text of at most {limit} characters expected, found {shown(value)}")
    return value


def read_integer(value: Any, low: int = 0, high: int = MAX_STAMP) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"integer from {low} to {high} expected, found {shown(value)}")
    return value


def read_boolean(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"boolean expected, found {shown(value)}")
    return value


def read_fields(value: Any, count: int) -> list[Any]:
    if not isinstance(value, list) or len(value) != count:
        raise ValueError(f"list of {count} expected, found {shown(value)}")
    return value


def texts_by_reason(reasons: Mapping[str, str]) -> dict[str, list[str]]:
    """Convert text -> reason to reason -> its texts, sorted."""
    found: dict[str, list[str]] = {}
    for text, reason in sorted(reasons.items(), key=lambda pair: (pair[1], pair[0])):
        found.setdefault(reason, []).append(text)
    return found


def read_reasons(value: Any, most: int, longest: int) -> dict[str, str]:
    """The inverse of `texts_by_reason`, for at most `most` texts and reasons up to `longest`."""
    if not isinstance(value, dict) or not all(isinstance(each, list) for each in value.values()):
        raise ValueError(f"map of reasons to lists expected, found {shown(value)}")
    if sum(map(len, value.values())) > most:
        raise ValueError(f"at most {most} texts expected")
    return dict(
        sorted(
            (read_text(text), read_text(reason, longest))
            for reason, texts in value.items()
            for text in texts
        )
    )


def read_data(data: Any) -> Any:
    """Accept plain data of any kind that is not nested too deeply."""
    level = [data]
    for _ in range(MAX_DATA_DEPTH + 1):
        level = [
            part
            for each in level
            if isinstance(each, (list, tuple, dict))
            for part in (each.values() if isinstance(each, dict) else each)
        ]
        if not level:
            return data
    raise ValueError(f"data nested more than {MAX_DATA_DEPTH} levels deep")
