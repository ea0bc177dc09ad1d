"""Stricter JSON hooks: refuse what the standard library accepts but no author intends."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

# The largest numbers of the project have fewer digits.
MOST_DIGITS = 40


def without_doubles(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Hook for the pairs of an object. Raises ValueError for a name that is given twice."""
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"{name!r:.80} is given twice")
        found[name] = value
    return found


def bounded_whole(text: str) -> int:
    """Hook for whole numbers. Raises ValueError for one of more than `MOST_DIGITS` characters."""
    if len(text) > MOST_DIGITS:
        raise ValueError(f"a number of {len(text)} digits")
    return int(text)
