"""JSON that others have written: what the standard library takes, and people did not mean."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

# Digits of the largest numbers that anything here has.
MOST_DIGITS = 40


def without_doubles(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """A hook for the pairs of an object; raises ValueError for a name that is given twice."""
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"{name!r:.80} is given twice")
        found[name] = value
    return found


def bounded_whole(text: str) -> int:
    """A hook for whole numbers; raises ValueError for one that is far too long."""
    if len(text) > MOST_DIGITS:
        raise ValueError(f"a number of {len(text)} digits")
    return int(text)
