"""Proofs that requests cannot be kept, by Hall's theorem.

A set of robots is a *Hall witness* against a request if the requests kept before it and its own
demands have more slots for none but these robots than there are (Hall, 1935). One set often serves
as the witness against many requests. While it does, none of them is looked at again.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from heapq import heappush

from mrbt_mesh.core.incremental.consistency.slots import OrderedRequest


class HallWitness:
    """A set of robots, and the requests against which it is the witness, by label.

    `slots`: how many slots the request has for none but these robots. `deficits`: how many robots
    are too few for them, given the requests kept before it; at least 1, or it is no witness
    against this request any more.
    """

    __slots__ = ("deficits", "labels", "robots", "slots")

    def __init__(self, robots: int) -> None:
        self.robots = robots
        self.labels: list[int] = []
        self.slots: list[int] = []
        self.deficits: list[int] = []

    def left(self, label: int) -> int:
        """At most so many of the robots are left for a request with this label or a later one.

        The label must not be before the first request that it is the witness against.
        """
        index = bisect_right(self.labels, label) - 1
        return self.slots[index] - self.deficits[index]

    def add(self, label: int, slots: int, deficit: int) -> None:
        """It is the witness against one more request."""
        index = bisect_left(self.labels, label)
        self.labels.insert(index, label)
        self.slots.insert(index, slots)
        self.deficits.insert(index, deficit)

    def remove(self, label: int) -> None:
        """It is not the witness against the request with this label any more."""
        index = bisect_left(self.labels, label)
        del self.labels[index], self.slots[index], self.deficits[index]

    def change(self, start: int, more: int) -> None:
        """So many more robots are too few for the requests from index `start` on."""
        self.deficits[start:] = [deficit + more for deficit in self.deficits[start:]]

    def first_unproven(self, start: int) -> int | None:
        """The label of the first request from index `start` on that nothing is proven against."""
        rest = self.deficits[start:]
        if not rest or min(rest) > 0:
            return None
        return self.labels[start + next(i for i, deficit in enumerate(rest) if deficit <= 0)]


class HallWitnesses:
    """The witnesses against all requests that are not kept.

    Labels of requests that nothing is proven against any more are put into the heap `due`.
    """

    def __init__(self, due: list[int]) -> None:
        self._due = due
        self._all: list[HallWitness] = []
        self._against: dict[OrderedRequest, HallWitness] = {}
        self._last_label = -1

    def add(self, request: OrderedRequest, witness: HallWitness | int, deficit: int) -> None:
        """A request cannot be kept: a witness known already, or a new set of robots, shows it."""
        if isinstance(witness, int):
            witness = HallWitness(witness)
            self._all.insert(0, witness)
        witness.add(request.label, request.slots_among(witness.robots), deficit)
        self._against[request] = witness
        self._last_label = max(self._last_label, request.label)

    def remove(self, request: OrderedRequest) -> None:
        """Nothing is proven against a request any more."""
        witness = self._against.pop(request, None)
        if witness is None:
            return
        witness.remove(request.label)
        if witness.labels:
            self._recheck(witness, 0)
        else:
            self._all.remove(witness)

    def confirm(self, request: OrderedRequest) -> bool:
        """Whether there is a witness against a request; one that is none any more is removed."""
        witness = self._against.get(request)
        if witness is None:
            return False
        index = bisect_left(witness.labels, request.label)
        if witness.deficits[index] <= 0:
            self.remove(request)
            return False
        self._recheck(witness, index + 1)
        return True

    def find(self, request: OrderedRequest) -> tuple[tuple[HallWitness, int] | None, list[int]]:
        """What is known of a request that is to be decided.

        (A witness against it and the deficit, or None; sets of robots of which no more can be
        had at its label, however the matching is changed.)
        """
        label, exhausted = request.label, list[int]()
        groups = [(group.pool.robots, group.slots) for group in request.groups]
        for place, witness in enumerate(self._all):
            if witness.labels[0] > label:
                continue
            left, robots, slots = witness.left(label), witness.robots, 0
            for candidates, count in groups:
                if candidates & robots == candidates:
                    slots += count
            if slots > left:
                if place:  # it may well be the witness against the next one, too
                    self._all.insert(0, self._all.pop(place))
                return (witness, slots - left), exhausted
            if left <= 0:
                exhausted.append(robots)
        return None, exhausted

    def clear(self) -> None:
        """Forget all that is proven, without asking for any decision."""
        self._all.clear()
        self._against.clear()

    # -- changes ------------------------------------------------------------------------------

    def robot_comes(self, robot: int) -> None:
        """One more robot is free."""
        for witness in self._all:
            if witness.robots & robot:
                witness.change(0, -1)
                self._recheck(witness, 0)

    def robot_goes(self, robot: int) -> None:
        """A robot is free no more."""
        for witness in self._all:
            if witness.robots & robot:
                witness.change(0, 1)

    def slots_change(self, candidates: int, more: int, label: int) -> None:
        """The requests kept up to a label have so many more slots for these candidates."""
        if label >= self._last_label or not more:
            return
        for witness in self._all:
            if candidates & witness.robots == candidates:
                start = bisect_right(witness.labels, label)
                witness.change(start, more)
                if more < 0:
                    self._recheck(witness, start)

    def include(self, robot: int, is_free: bool, wider: Sequence[int]) -> None:
        """Before a new robot becomes a candidate, as one of the sets `wider` of candidates.

        A witness that has all other robots of such a set would say nothing of that demand any
        more: the robot is made one of its own.
        """
        for witness in self._all:
            known = witness.robots | robot
            if any(robots | known == known for robots in wider):
                witness.robots = known
                if is_free:
                    witness.change(0, -1)
                    self._recheck(witness, 0)

    def _recheck(self, witness: HallWitness, start: int) -> None:
        label = witness.first_unproven(start)
        if label is not None:
            heappush(self._due, label)
