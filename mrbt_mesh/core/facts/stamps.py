"""Limits on how far one robot can drive shared, continued numbers ahead.

A stamp or a count of changes has an upper limit. If every robot continued from the greatest number
that any robot has written, one lying robot could use up all numbers with a single fact. Of the two
authors with the greatest numbers at least one is honest. So honest robots have reached the second
greatest number, and the greatest counts only up to a distance above that.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

# The number of stamped facts that one robot may write while no other robot writes any. Further ones
# still count, but later facts of other robots have smaller stamps.
MAX_STAMPS_AHEAD = 1 << 24
# How often a condition may change, or a loop be attempted, while only one robot writes it.
MAX_CHANGES_AHEAD = 1 << 32
# The most facts remembered that have counts which no honest robot reaches.
MAX_SUSPICIOUS = 1_000


def second_greatest(numbers: Collection[int]) -> int:
    """The second greatest number, where there is one per author; 0 if there are fewer than two."""
    return sorted(numbers)[-2] if len(numbers) > 1 else 0


class Stamps:
    """The greatest Lamport stamp of each author. `me`: the robot that continues from them."""

    def __init__(self, me: str) -> None:
        self._me = me
        self._by_author: dict[str, int] = {}

    def see(self, author: str, stamp: int) -> None:
        """Note that a fact of this author has this stamp."""
        if stamp > self._by_author.get(author, 0):
            self._by_author[author] = stamp

    @property
    def greatest(self) -> int:
        """The greatest stamp, at most `MAX_STAMPS_AHEAD` above the second greatest or this robot's
        own.
        """
        stamps = self._by_author.values()
        confirmed = max(second_greatest(stamps), self._by_author.get(self._me, 0))
        return min(max(stamps, default=0), confirmed + MAX_STAMPS_AHEAD)


class Counts:
    """Finds counts (of changes, of attempts) that are too far above those of all other authors."""

    def __init__(self) -> None:
        # Name of a fact -> author -> its count, above `MAX_CHANGES_AHEAD`.
        self._suspicious: dict[str, dict[str, int]] = {}

    def is_too_far_ahead(
        self, name: str, author: str, count: int, known: Callable[[], Mapping[str, int]]
    ) -> bool:
        """True for a count so far above those of all other authors that nobody may continue it.

        `known`: the counts of this fact in the map, by author. An author's greatest count stays
        there, so a count that continues it is never too far ahead.
        """
        if count <= MAX_CHANGES_AHEAD:
            return False
        if len(self._suspicious) >= MAX_SUSPICIOUS:
            self._suspicious.clear()
        seen = self._suspicious.setdefault(name, {})
        seen[author] = max(count, seen.get(author, 0))
        counts = dict(known())
        others = {by: max(number, counts.get(by, 0)) for by, number in seen.items()}
        return count > second_greatest((counts | others).values()) + MAX_CHANGES_AHEAD
