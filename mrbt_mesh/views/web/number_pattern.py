"""A regular expression for the texts of whole numbers in a range."""

from __future__ import annotations

from collections.abc import Iterator


def range_pattern(low: int, high: int) -> str:
    """Return a pattern for the numbers from `low` to `high`, without leading zeros.

    It matches no other text. JSON Schema needs it, as it has no ranges for texts. Raises ValueError
    if `low` is above `high`.
    """
    if low > high:
        raise ValueError(f"no number is from {low} to {high}")
    parts = [f"-{each}" for each in _naturals(max(1, -high), -low)]
    return f"^({'|'.join([*parts, *_naturals(max(0, low), high)])})$"


def _naturals(low: int, high: int) -> Iterator[str]:
    """Yield the patterns for the numbers of each length."""
    for length in range(len(str(low)), len(str(max(0, high))) + 1):
        first = max(low, 10 ** (length - 1) if length > 1 else 0)
        last = min(high, 10**length - 1)
        if first <= last:
            yield _same_length(str(first), str(last))


def _same_length(first: str, last: str) -> str:
    rest = len(first) - 1
    if first == last:
        return first
    if first[1:] == "0" * rest and last[1:] == "9" * rest:
        return f"[{first[0]}-{last[0]}]" + (f"[0-9]{{{rest}}}" if rest else "")
    if first[0] == last[0]:
        return first[0] + _same_length(first[1:], last[1:])
    parts = [first[0] + _same_length(first[1:], "9" * rest)]
    if int(last[0]) - int(first[0]) > 1:
        parts.append(f"[{int(first[0]) + 1}-{int(last[0]) - 1}][0-9]{{{rest}}}")
    parts.append(last[0] + _same_length("0" * rest, last[1:]))
    return f"({'|'.join(parts)})"
