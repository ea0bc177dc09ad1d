"""A bipartite matching of robots and slots that grows and shrinks along augmenting paths.

Slots with the same candidates share a pool, so a search goes from pool to pool. It is breadth
first, so it finds a shortest augmenting path (Berge, 1957; Hopcroft and Karp, 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heappush
from typing import TypeAlias

from mrbt_mesh.core.incremental.consistency.slots import OrderedRequest, Pool, SlotGroup

# What was done, so that it can be undone: (robot, pool that it leaves or None, pool that it joins),
# or (group that has lost a robot, None, None).
Change: TypeAlias = "tuple[int, Pool | None, Pool] | tuple[SlotGroup, None, None]"
# By pool that a search has reached: the robot that it can give up, and to which pool.
Predecessors: TypeAlias = "dict[Pool, tuple[int, Pool] | None]"


class Matching:
    """Which robot fills which slot.

    `free` robots may be matched, those of them that are not are `unmatched`. A request that loses
    a robot to an earlier one is put into the heap `due`, by its label.
    """

    def __init__(self, free: int, due: list[int]) -> None:
        self.free = free
        self.unmatched = free
        self._due = due
        self._pools: dict[int, Pool] = {}
        # By the number of a robot's bit, counted from 1.
        self._pool_of: list[Pool | None] = [None] * (free.bit_length() + 1)

    # -- pools and robots ---------------------------------------------------------------------

    def join_pool(self, candidates: int) -> Pool:
        """The pool of these candidates, for one more demand."""
        pool = self._pools.get(candidates)
        if pool is None:
            pool = self._pools[candidates] = Pool(candidates)
        pool.users += 1
        return pool

    def leave_pool(self, pool: Pool) -> None:
        """A demand has other candidates now, or is gone."""
        pool.users -= 1
        if not pool.users:
            del self._pools[pool.robots]

    def can_extend(self, pool: Pool, robot: int, users: int) -> bool:
        """Whether `extend` does what moving so many of a pool's demands to another would do."""
        return users == pool.users and pool.robots | robot not in self._pools

    def extend(self, pool: Pool, robot: int) -> None:
        """A new robot is a candidate for all demands of a pool."""
        del self._pools[pool.robots]
        pool.robots |= robot
        self._pools[pool.robots] = pool

    def add_robot(self, robot: int) -> None:
        """One more robot is free."""
        self.free |= robot
        self.unmatched |= robot
        self._pool_of.extend([None] * (robot.bit_length() + 1 - len(self._pool_of)))

    def remove_robot(self, robot: int) -> None:
        """A robot is free no more; if it was matched, the last request of its pool loses one."""
        self.free ^= robot
        if self.unmatched & robot:
            self.unmatched ^= robot
            return
        pool = self._pool_of[robot.bit_length()]
        assert pool is not None
        pool.matched ^= robot
        self._take_from_last(pool)

    def set_free(self, free: int) -> None:
        """Other robots are free; those that are not, but are matched, stay so."""
        self.free = free
        self.unmatched = free
        for pool in self._pools.values():
            self.unmatched &= ~pool.matched

    def robots(self) -> dict[int, OrderedRequest]:
        """Robot -> request, for all that are matched."""
        found = {}
        for pool in self._pools.values():
            matched = pool.matched
            for group in pool.filled:
                for _ in range(group.count):
                    robot = matched & -matched
                    matched ^= robot
                    found[robot] = group.request
        return found

    # -- filling and emptying slots -----------------------------------------------------------

    def take_unmatched(self, pool: Pool, changes: list[Change]) -> bool:
        """One more robot for a pool, if one of its candidates is unmatched."""
        found = pool.robots & self.unmatched
        if not found:
            return False
        robot = found & -found
        self.unmatched ^= robot
        pool.matched ^= robot
        self._pool_of[robot.bit_length()] = pool
        changes.append((robot, None, pool))
        return True

    def augment(
        self, start: Pool, label: int, later: int, exhausted: Sequence[int], changes: list[Change]
    ) -> int | None:
        """One more robot for a pool, along a shortest augmenting path.

        It ends with an unmatched robot, or with one that a request after `label` loses; `later`:
        robots in whose pools such a request has some, not necessarily all of them. Robots in
        `exhausted` sets are known to lead nowhere. Returns None on success, else the set of all
        robots that can be reached: none of them can be had.
        """
        came_from: Predecessors = {start: None}
        if start.filled and start.filled[-1].request.label > label:
            self._take_from_last(start, changes)
            return None
        unseen = self.free & ~start.matched
        for robots in exhausted:
            unseen &= ~robots
        pool_of, goal = self._pool_of, self.unmatched | later
        if start.robots & goal:
            self._end(start, start.robots & goal, came_from, changes)
            return None
        queue = [start]
        for pool in queue:
            found = pool.robots & unseen
            unseen ^= found
            while found:
                robot = found & -found
                other = pool_of[robot.bit_length()]
                assert other is not None
                found ^= found & other.matched
                unseen ^= unseen & other.matched
                came_from[other] = (robot, pool)
                if other.filled[-1].request.label > label:
                    self._take_from_last(other, changes)
                    self._shift(other, came_from, changes)
                    return None
                if other.robots & goal:
                    self._end(other, other.robots & goal, came_from, changes)
                    return None
                queue.append(other)
        reached = 0
        for pool in queue:
            reached |= pool.robots
        met = reached & self.free
        for robots in exhausted:
            if robots & met:
                reached |= robots
        return reached

    def _end(self, pool: Pool, ends: int, came_from: Predecessors, changes: list[Change]) -> None:
        """A path ends with a pool that can have any of the robots `ends`: carry it out."""
        if ends & self.unmatched:
            self.take_unmatched(pool, changes)
        else:
            robot = ends & -ends
            last = self._pool_of[robot.bit_length()]
            assert last is not None
            came_from[last] = (robot, pool)
            self._take_from_last(last, changes)
            pool = last
        self._shift(pool, came_from, changes)

    def _shift(self, pool: Pool, came_from: Predecessors, changes: list[Change]) -> None:
        """Along a path back to its start, each pool gives a robot to the one before it."""
        step = came_from[pool]
        while step is not None:
            robot, before = step
            pool.matched ^= robot
            before.matched ^= robot
            self._pool_of[robot.bit_length()] = before
            changes.append((robot, pool, before))
            pool, step = before, came_from[before]

    def _take_from_last(self, pool: Pool, changes: list[Change] | None = None) -> None:
        """The last request of a pool has one slot less filled."""
        group = pool.filled[-1]
        group.count -= 1
        if not group.count:
            pool.filled.pop()
        heappush(self._due, group.request.label)
        if changes is not None:
            changes.append((group, None, None))

    def empty(self, group: SlotGroup, count: int) -> None:
        """So many of a demand's slots are filled no more."""
        pool = group.pool
        group.count -= count
        if count and not group.count:
            pool.filled.remove(group)
        for _ in range(count):
            robot = pool.matched & -pool.matched
            pool.matched ^= robot
            self.unmatched |= robot

    def move(self, group: SlotGroup, pool: Pool) -> None:
        """A demand goes to another pool, with those of its robots that are candidates there."""
        old = group.pool
        common, moved = old.matched & pool.robots, 0
        while common and moved < group.count:
            robot = common & -common
            common ^= robot
            old.matched ^= robot
            pool.matched ^= robot
            self._pool_of[robot.bit_length()] = pool
            moved += 1
        self.empty(group, group.count - moved)
        if moved:
            old.filled.remove(group)
            group.count = moved
            pool.add_filled(group)
        group.pool = pool

    def undo(self, changes: list[Change]) -> None:
        """Undo what was done, the last thing first."""
        for what, source, pool in reversed(changes):
            if isinstance(what, SlotGroup):
                what.count += 1
                if what.count == 1:
                    what.pool.add_filled(what)
                continue
            assert pool is not None
            pool.matched ^= what
            self._pool_of[what.bit_length()] = source
            if source is None:
                self.unmatched ^= what
            else:
                source.matched ^= what
