"""Who looks after whom: the robots of a team in a ring, each beside a few others.

In a team of at most `2 * reach + 1` robots everybody is everybody's neighbour. In a larger one a
robot's neighbours are the `reach` robots on either side of it: they hear its heartbeats, judge its
silence and pass news of it on to one another. So what a robot sends and receives does not grow with
its team.

Robots stand in the ring by a hash of their ids, so that those that fail together, because they are
alike or near one another, are seldom neighbours. All that know of the same robots have the same
ring (consistent hashing: Karger et al. 1997; neighbours as monitors: Chord, Stoica et al. 2001).
"""

from __future__ import annotations

import hashlib
from bisect import bisect_left
from collections.abc import Iterable
from functools import lru_cache


@lru_cache(maxsize=4_096)
def place(robot: str) -> bytes:
    """Where a robot stands in the ring: 8 bytes."""
    return hashlib.blake2b(robot.encode(), digest_size=8).digest()


class Ring:
    """The ring of some robots. `reach`: how far neighbours are apart at most, on either side."""

    def __init__(self, robots: Iterable[str], reach: int) -> None:
        self._order = sorted(robots, key=lambda robot: (place(robot), robot))
        self._keys = [(place(robot), robot) for robot in self._order]
        self._reach = reach

    @property
    def is_complete(self) -> bool:
        """Whether everybody is everybody's neighbour."""
        return len(self._order) <= 2 * self._reach + 1

    def neighbours(self, robot: str) -> tuple[str, ...]:
        """Those of a robot, sorted by id; of one that is not in the ring, those it would have."""
        order, reach = self._order, self._reach
        at = bisect_left(self._keys, (place(robot), robot))
        is_in = at < len(order) and order[at] == robot
        others = len(order) - is_in
        if others <= 2 * reach:
            return tuple(sorted(each for each in order if each != robot))
        after = at + 1 if is_in else at
        near = [*range(at - reach, at), *range(after, after + reach)]
        return tuple(sorted(order[index % len(order)] for index in near))
