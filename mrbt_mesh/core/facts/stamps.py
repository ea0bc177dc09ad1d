"""Numbers that robots continue from one another: how far one robot can drive them ahead.

A stamp or a count of changes has an upper limit. If every robot continued from the greatest number
that any robot has written, one robot that lies could use up all numbers with a single fact. Among
the two authors with the greatest numbers at least one is honest, so the second greatest number is
one that honest robots have come to, and the greatest counts only up to a distance above it.
"""

from __future__ import annotations

from collections.abc import Collection

# One robot may write this many stamped facts while no other writes any; beyond that, its facts
# still count, but later ones of others have smaller stamps.
MAX_STAMPS_AHEAD = 1 << 24
# A condition may change this often while only one robot sets it.
MAX_CHANGES_AHEAD = 1 << 32


def second_greatest(numbers: Collection[int]) -> int:
    """The second greatest of these, one per author; 0 if there are fewer than two."""
    return sorted(numbers)[-2] if len(numbers) > 1 else 0


class Stamps:
    """The greatest Lamport stamp of each author. `me`: the robot that continues from them."""

    def __init__(self, me: str) -> None:
        self._me = me
        self._by_author: dict[str, int] = {}

    def see(self, author: str, stamp: int) -> None:
        """A fact of this author has this stamp."""
        if stamp > self._by_author.get(author, 0):
            self._by_author[author] = stamp

    @property
    def greatest(self) -> int:
        """The greatest one, at most `MAX_STAMPS_AHEAD` above the second greatest, or one's own."""
        stamps = self._by_author.values()
        confirmed = max(second_greatest(stamps), self._by_author.get(self._me, 0))
        return min(max(stamps, default=0), confirmed + MAX_STAMPS_AHEAD)
