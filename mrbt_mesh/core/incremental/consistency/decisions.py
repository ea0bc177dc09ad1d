"""Which requests are kept, decided again after a change only where the change may matter.

Requests stand in the order of their labels. One is kept if its slots and those of all requests
kept before it can be filled by different robots: the rule of `planning.consistency`. For a request
that is kept the matching shows it, for any other a Hall witness.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable, Sequence
from heapq import heappop, heappush

from mrbt_mesh.core.incremental.consistency.hall_witnesses import HallWitness, HallWitnesses
from mrbt_mesh.core.incremental.consistency.matching import Change, Matching
from mrbt_mesh.core.incremental.consistency.slots import OrderedRequest, SlotGroup

# To look for robots of later requests is worth while if so many are kept at most.
_FEW = 48


class Decisions:
    """Which requests are kept; `decide_due` brings it up to date after changes.

    A request may take robots from requests after it, which are then due. `version` grows whenever
    another decision is made about a request.
    """

    def __init__(self, free: int = 0) -> None:
        self.requests: dict[int, OrderedRequest] = {}
        self.version = 0
        self._due: list[int] = []  # a heap of labels
        self.matching = Matching(free, self._due)
        self._witnesses = HallWitnesses(self._due)
        self._kept: list[int] = []  # labels, sorted

    # -- requests -----------------------------------------------------------------------------

    def add(self, request: OrderedRequest, demands: Iterable[tuple[int, int]]) -> None:
        """A new request with its demands: (candidates, slots). It is not decided yet."""
        join = self.matching.join_pool
        request.groups = [SlotGroup(request, join(robots), slots) for robots, slots in demands]
        self.requests[request.label] = request

    def remove(self, request: OrderedRequest) -> None:
        """A request is gone."""
        self.exclude(request)
        for group in request.groups:
            self.matching.leave_pool(group.pool)
        del self.requests[request.label]

    def exclude(self, request: OrderedRequest) -> None:
        """A request is not kept, whatever fits, until it is due again."""
        request.excluded = True
        if request.kept:
            self._reject(request)
        else:
            self._witnesses.remove(request)

    def make_due(self, request: OrderedRequest) -> None:
        """A request is to be decided."""
        request.excluded = False
        heappush(self._due, request.label)

    def set_slots(self, group: SlotGroup, slots: int) -> None:
        """A demand has another number of slots."""
        request, more = group.request, slots - group.slots
        group.slots = slots
        if not request.kept:
            self._forget(request)
            return
        self._witnesses.slots_change(group.pool.robots, more, request.label)
        if group.count > slots:
            self.matching.empty(group, group.count - slots)
        elif group.count < slots:
            self.make_due(request)

    def set_candidates(self, group: SlotGroup, robots: int) -> None:
        """A demand has other candidates."""
        request, old = group.request, group.pool
        new = self.matching.join_pool(robots)
        if request.kept:
            self._witnesses.slots_change(new.robots, group.slots, request.label)
            self._witnesses.slots_change(old.robots, -group.slots, request.label)
        self.matching.move(group, new)
        self.matching.leave_pool(old)
        if not request.kept:
            self._forget(request)
        elif group.count < group.slots:
            self.make_due(request)

    def _forget(self, request: OrderedRequest) -> None:
        """What was decided of a request that is not kept holds no more."""
        if not request.excluded:
            self._witnesses.remove(request)
            self.make_due(request)

    # -- robots -------------------------------------------------------------------------------

    def add_robot(self, robot: int) -> None:
        """One more robot is free."""
        self.matching.add_robot(robot)
        self._witnesses.robot_comes(robot)

    def remove_robot(self, robot: int) -> None:
        """A robot is free no more."""
        self._witnesses.robot_goes(robot)
        self.matching.remove_robot(robot)

    def set_free(self, free: int) -> None:
        """Other robots are free, for requests that are still to be added."""
        self.matching.set_free(free)
        self._witnesses.clear()

    def introduce(self, robot: int, candidates: Sequence[int]) -> None:
        """Before a new robot becomes a candidate: `candidates` are the sets that it will be in."""
        self._witnesses.include(robot, bool(self.matching.free & robot), candidates)

    # -- decisions ----------------------------------------------------------------------------

    def decide_due(self) -> None:
        """Decide all that is due, and what follows from it, in the order of the labels."""
        due = self._due
        while due:
            request = self.requests.get(heappop(due))
            if request is None or request.excluded:
                continue
            if request.has_empty_slots if request.kept else not self._witnesses.confirm(request):
                self.decide(request)

    def decide(self, request: OrderedRequest) -> bool:
        """Keep a request if it fits; every request kept before it has all its slots filled."""
        proof = self._fill(request, [])
        if proof is not None:
            if request.kept:
                self._reject(request)
            self._witnesses.add(request, *proof)
        elif not request.kept:
            request.kept = True
            insort(self._kept, request.label)
            self._kept_changes(request, 1)
        return proof is None

    def fits(self, request: OrderedRequest) -> bool:
        """Whether `decide` would keep a new request."""
        changes: list[Change] = []
        if self._fill(request, changes) is not None:
            return False
        self._take_back(request, changes, [0] * len(request.groups))
        return True

    def _fill(
        self, request: OrderedRequest, changes: list[Change]
    ) -> tuple[HallWitness | int, int] | None:
        """Fill all slots of a request; or (a witness or its robots, the deficit), and no change."""
        before = [group.count for group in request.groups]
        exhausted: list[int] | None = None
        for group in request.groups:
            pool = group.pool
            while group.count < group.slots:
                if not self.matching.take_unmatched(pool, changes):
                    if exhausted is None:
                        known, exhausted = self._witnesses.find(request)
                        if known is not None:
                            self._take_back(request, changes, before)
                            return known
                    later = self._robots_after(request.label)
                    reached = self.matching.augment(pool, request.label, later, exhausted, changes)
                    if reached is not None:
                        deficit = sum(
                            each.slots - each.count
                            for each in request.groups
                            if each.pool.robots & reached == each.pool.robots
                        )
                        self._take_back(request, changes, before)
                        return reached, deficit
                group.count += 1
                if group.count == 1:
                    pool.add_filled(group)
        return None

    def _robots_after(self, label: int) -> int:
        """Robots in pools where a request after a label has some; 0 if too many are kept there."""
        start = bisect_right(self._kept, label)
        robots = 0
        if len(self._kept) - start <= _FEW:
            for each in self._kept[start:]:
                for group in self.requests[each].groups:
                    robots |= group.pool.matched if group.count else 0
        return robots

    def _take_back(
        self, request: OrderedRequest, changes: list[Change], before: Sequence[int]
    ) -> None:
        """Undo changes made to fill a request."""
        self.matching.undo(changes)
        for group, count in zip(request.groups, before, strict=True):
            if group.count and not count:
                group.pool.filled.remove(group)
            group.count = count

    def _reject(self, request: OrderedRequest) -> None:
        """A request is kept no more."""
        request.kept = False
        del self._kept[bisect_left(self._kept, request.label)]
        for group in request.groups:
            self.matching.empty(group, group.count)
        self._kept_changes(request, -1)

    def _kept_changes(self, request: OrderedRequest, sign: int) -> None:
        self.version += 1
        for group in request.groups:
            robots, slots = group.pool.robots, sign * group.slots
            self._witnesses.slots_change(robots, slots, request.label)
