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
        self._keys = sorted((place(robot), robot) for robot in robots)
        self._reach = reach

    def put(self, robot: str, is_in: bool) -> None:
        """Let a robot have its place in the ring, or none."""
        key = (place(robot), robot)
        at = bisect_left(self._keys, key)
        was_in = at < len(self._keys) and self._keys[at] == key
        if is_in and not was_in:
            self._keys.insert(at, key)
        elif was_in and not is_in:
            del self._keys[at]

    @property
    def is_complete(self) -> bool:
        """Whether everybody is everybody's neighbour."""
        return len(self._keys) <= 2 * self._reach + 1

    def are_near(self, robot: str, other: str) -> bool:
        """Whether `other`, which is in the ring, is among the neighbours of a robot."""
        keys, key = self._keys, (place(robot), robot)
        at = bisect_left(keys, key)
        is_in = at < len(keys) and keys[at] == key
        if robot == other or len(keys) - is_in <= 2 * self._reach:
            return robot != other
        steps = (bisect_left(keys, (place(other), other)) - at) % len(keys)
        reach = self._reach if is_in else self._reach - 1
        return steps <= reach or steps >= len(keys) - self._reach

    def neighbours(self, robot: str) -> tuple[str, ...]:
        """Those of a robot, sorted by id; of one that is not in the ring, those it would have."""
        keys, reach = self._keys, self._reach
        at = bisect_left(keys, (place(robot), robot))
        is_in = at < len(keys) and keys[at][1] == robot
        others = len(keys) - is_in
        if others <= 2 * reach:
            return tuple(sorted(each for _, each in keys if each != robot))
        after = at + 1 if is_in else at
        near = [*range(at - reach, at), *range(after, after + reach)]
        return tuple(sorted(keys[index % len(keys)][1] for index in near))
