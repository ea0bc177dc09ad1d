"""The side of the matching that asks for robots: requests, the slots of their demands, pools.

Sets of robots are bits of ints (`robot_bits`).
"""

from __future__ import annotations

from bisect import insort
from typing import Any


class Pool:
    """The candidates of some demands, where these are the same robots.

    `matched`: those of the robots that fill a slot of one of these demands; which of the slots
    does not matter. `filled`: the demands with a filled slot, by label. `users`: how many demands
    have these candidates.
    """

    __slots__ = ("filled", "matched", "robots", "users")

    def __init__(self, robots: int) -> None:
        self.robots = robots
        self.matched = 0
        self.filled: list[SlotGroup] = []
        self.users = 0

    def add_filled(self, group: SlotGroup) -> None:
        """One of the demands has its first filled slot."""
        insort(self.filled, group, key=lambda group: group.request.label)


class SlotGroup:
    """One demand of a request: `slots` for robots of a pool, of which `count` are filled."""

    __slots__ = ("count", "pool", "request", "slots")

    def __init__(self, request: OrderedRequest, pool: Pool, slots: int) -> None:
        self.request = request
        self.pool = pool
        self.slots = slots
        self.count = 0


class OrderedRequest:
    """One request. Requests are taken in the order of their labels.

    `source` and `index` are the caller's. An `excluded` request is never kept.
    """

    __slots__ = ("excluded", "groups", "index", "kept", "label", "source")

    def __init__(self, label: int, source: Any) -> None:
        self.label = label
        self.source = source
        self.index = 0
        self.groups: list[SlotGroup] = []
        self.kept = False
        self.excluded = False

    @property
    def has_empty_slots(self) -> bool:
        """Whether a slot is not filled."""
        return any(group.count < group.slots for group in self.groups)

    def slots_among(self, robots: int) -> int:
        """How many of its slots can be filled by none but these robots."""
        count = 0
        for group in self.groups:
            candidates = group.pool.robots
            if candidates & robots == candidates:
                count += group.slots
        return count
