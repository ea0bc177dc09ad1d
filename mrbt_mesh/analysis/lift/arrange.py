"""From an order in which some things must happen to Sequences and Parallels of them.

A set of dependences is a partial order. One that is *series-parallel* is exactly a nesting of
series (all of one part before all of the next) and of parts in parallel; others contain the
letter N (a before c and d, b before d only) and can only be kept by adding dependences.
Source: Valdes, Tarjan, Lawler, "The recognition of series parallel digraphs" (1982).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias


@dataclass(frozen=True, slots=True)
class Series:
    """One part after the other."""

    parts: tuple[Arrangement, ...]


@dataclass(frozen=True, slots=True)
class Parallel:
    """All parts at the same time."""

    parts: tuple[Arrangement, ...]


# An element is its number.
Arrangement: TypeAlias = Series | Parallel | int
Pair: TypeAlias = tuple[int, int]


def closure(count: int, before: Iterable[Pair]) -> list[set[int]]:
    """For each element all that come after it. Of a pair (i, j), i < j, i comes first."""
    after: list[set[int]] = [set() for _ in range(count)]
    for first, second in sorted(before, reverse=True):
        after[first] |= {second} | after[second]
    return after


def arrange(
    count: int, before: Iterable[Pair], work: Sequence[int]
) -> tuple[Arrangement, tuple[Pair, ...]]:
    """The least constrained arrangement found of the elements 0 to `count` - 1.

    `before` holds pairs (i, j) with i < j. Where the order is series-parallel, the arrangement
    keeps exactly that order; otherwise pairs are added, and returned: those of a cut that
    lengthens the critical path least (`work` per element), then adds the fewest.
    """
    after = closure(count, before)
    added: list[Pair] = []
    return _arranged(tuple(range(count)), after, work, added), tuple(sorted(added))


def _arranged(
    elements: tuple[int, ...], after: list[set[int]], work: Sequence[int], added: list[Pair]
) -> Arrangement:
    if len(elements) == 1:
        return elements[0]
    parts = _components(elements, lambda i, j: j in after[i] or i in after[j])
    if len(parts) > 1:
        return Parallel(tuple(_arranged(part, after, work, added) for part in parts))
    parts = _components(elements, lambda i, j: j not in after[i] and i not in after[j])
    if len(parts) == 1:
        parts = _cut(elements, after, work, added)
    # Of two parts all of one come before all of the other: any two elements decide which.
    parts.sort(key=lambda part: sum(part[0] in after[other[0]] for other in parts))
    return Series(tuple(_arranged(part, after, work, added) for part in parts))


def _components(
    elements: tuple[int, ...], linked: Callable[[int, int], bool]
) -> list[tuple[int, ...]]:
    """The elements in connected groups, by their smallest."""
    left, parts = list(elements), []
    while left:
        part, waiting = [], [left.pop(0)]
        while waiting:
            here = waiting.pop()
            part.append(here)
            near = [other for other in left if linked(here, other)]
            left = [other for other in left if other not in near]
            waiting += near
        parts.append(tuple(sorted(part)))
    return parts


def _cut(
    elements: tuple[int, ...], after: list[set[int]], work: Sequence[int], added: list[Pair]
) -> list[tuple[int, ...]]:
    """Split into a first and a second part, and add all pairs between them to the order."""
    earliest = _earliest(elements, after, work)
    candidates = []
    for limit in sorted({earliest[e] for e in elements})[1:]:
        first = tuple(e for e in elements if earliest[e] < limit)
        second = tuple(e for e in elements if earliest[e] >= limit)
        new = [(i, j) for i in first for j in second if j not in after[i]]
        length = _length(first, after, work) + _length(second, after, work)
        candidates.append((length, len(new), first, second, new))
    _, _, first, second, new = min(candidates)
    added += new
    for i, j in new:
        after[i].add(j)
    return [first, second]


def _earliest(
    elements: tuple[int, ...], after: list[set[int]], work: Sequence[int]
) -> dict[int, tuple[int, int]]:
    """When each element can begin, and after how many others in a chain."""
    earliest = dict.fromkeys(elements, (0, 0))
    for first in elements:  # numbered in an order that keeps all pairs
        at, depth = earliest[first]
        for second in elements:
            if second in after[first]:
                earliest[second] = max(earliest[second], (at + work[first], depth + 1))
    return earliest


def _length(elements: tuple[int, ...], after: list[set[int]], work: Sequence[int]) -> int:
    earliest = _earliest(elements, after, work)
    return max(earliest[e][0] + work[e] for e in elements)
