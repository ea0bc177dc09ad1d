"""Which requests are kept, brought up to date: finds out what has changed since the last time.

Requests keep their labels, so that what has not changed keeps its place; new ones get labels
between those of their neighbours (list labeling: Dietz and Sleator, 1987).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import compress
from itertools import count as numbers
from operator import is_not
from typing import NamedTuple, TypeAlias

from mrbt_mesh.core.incremental.consistency.decisions import Decisions
from mrbt_mesh.core.incremental.consistency.robot_bits import RobotBits
from mrbt_mesh.core.incremental.consistency.slots import OrderedRequest, Pool, SlotGroup
from mrbt_mesh.core.planning.demands import Demand

Groups: TypeAlias = Sequence[Sequence[Demand]]
# (slot group, candidates, slots): what a demand is to be.
DemandChange: TypeAlias = tuple[SlotGroup, int, int]

_GAP = 1 << 40  # between the labels of neighbours, so that others can come in between


class SharedPinError(Exception):
    """A robot is pinned to two requests."""


class _RequestChanges(NamedTuple):
    """What is different about the requests, and all of them as they are now."""

    gone: Sequence[OrderedRequest]
    new: Sequence[OrderedRequest]
    changed: Sequence[tuple[OrderedRequest, Sequence[Demand]]]
    now: list[OrderedRequest]


class KeptRequests:
    """The requests that are kept with certain pins, without preemption.

    With more than one change per `requests_per_change` requests it starts from scratch. `pins`:
    robot -> the request that it is pinned to, whether or not the pin holds; those of `released`
    robots do not.
    """

    def __init__(self, bits: RobotBits, requests_per_change: int) -> None:
        self.requests: list[OrderedRequest] = []
        self.pins: dict[str, OrderedRequest] = {}
        self.released: frozenset[str] = frozenset()
        self._requests_per_change = requests_per_change
        self._bits = bits
        self._decisions = Decisions()
        self._joined = 0  # how many robots have joined that are known here
        self._robots = 0
        self._held = 0  # the robots whose pins hold
        self._excluded: dict[OrderedRequest, None] = {}
        self._groups: list[Sequence[Demand]] = []
        self._kept: tuple[int, list[OrderedRequest], list[int]] = (-1, [], [])

    @property
    def kept(self) -> list[int]:
        """The indices of the requests that are kept."""
        version, requests, kept = self._kept
        if version != self._decisions.version or requests is not self.requests:
            kept = [request.index for request in self.requests if request.kept]
            self._kept = (self._decisions.version, self.requests, kept)
        return kept

    def update(self, groups: Groups, excluded: Collection[int], released: frozenset[str]) -> None:
        """Take in the demands as they are now, and the robots.

        Raises SharedPinError, after which this object is of no use any more.
        """
        changes = self._request_changes(groups)
        if changes is None or not self._update(changes, excluded, released):
            self._start(groups, excluded, released)
        self._groups = list(groups)

    def _update(
        self, changes: _RequestChanges, excluded: Collection[int], released: frozenset[str]
    ) -> bool:
        """False: it has to start from scratch."""
        gone, new, changed, now = changes
        count = len(gone) + len(new)
        if self._are_many(count, len(now)) or not _labelled(now, new):
            return False
        now_excluded = {now[index]: None for index in excluded}
        turned = [each for each in self._excluded if each not in now_excluded and each not in gone]
        turned += [each for each in now_excluded if each not in self._excluded and each not in new]
        self._excluded = now_excluded
        newcomers = self._newcomers()
        self._repin(changes, turned, released)
        compared = dict.fromkeys([request for request, _ in changed] + turned)
        if released != self.released:
            other = [robot for robot in sorted(released ^ self.released) if robot in self.pins]
            compared |= dict.fromkeys(self.pins[robot] for robot in other)
            self.released = released
        for robot in newcomers:
            compared |= {each: None for each in now for d in each.source if robot in d.candidates}
        demands = self._demand_changes(compared)
        if demands is None:
            return False
        extended = self._extended(demands, newcomers)
        demands = [change for change in demands if change[0].pool not in extended]
        count += (self._robots & ~self._held ^ self._decisions.matching.free).bit_count()
        if self._are_many(count + len(demands) + len(extended), len(now)):
            return False
        for request in gone:
            self._decisions.remove(request)
        self._change_robots(newcomers, extended, demands)
        self._decide(new, turned, demands)
        self.requests = now
        return True

    def _are_many(self, changes: int, requests: int) -> bool:
        return changes * self._requests_per_change > requests

    def _start(self, groups: Groups, excluded: Collection[int], released: frozenset[str]) -> None:
        """From scratch."""
        bits = self._bits
        self.requests = [OrderedRequest(index * _GAP, group) for index, group in enumerate(groups)]
        self.pins.clear()
        self._held, self.released, self._robots = 0, released, bits.all
        self._joined = len(bits.joined)
        self._excluded = {self.requests[index]: None for index in excluded}
        for request in self.requests:
            if request not in self._excluded:
                self._pin(request)
        self._decisions = Decisions(bits.all & ~self._held)
        for index, request in enumerate(self.requests):
            request.index = index
            self._decisions.add(request, self._slots(request))
            if request in self._excluded:
                request.excluded = True
            else:
                self._decisions.decide(request)

    def _slots(self, request: OrderedRequest) -> list[tuple[int, int]]:
        """(candidates, slots) for each demand of a request: slots for robots not pinned to it."""
        mask, released = self._bits.mask, self.released
        found = []
        for demand in request.source:
            slots = demand.lower
            if slots and demand.pinned:
                slots = max(0, slots - sum(robot not in released for robot in demand.pinned))
            found.append((mask(demand.candidates), slots))
        return found

    # -- what has changed ---------------------------------------------------------------------

    def _request_changes(self, groups: Groups) -> _RequestChanges | None:
        """Compare by identity, then by activation; None: requests of one activation."""
        old, now = self._groups, self.requests
        shared = min(len(old), len(groups))
        start = next(compress(numbers(), map(is_not, old, groups)), shared)
        if start == len(old) == len(groups):
            return _RequestChanges([], [], [], now)
        end = next(compress(numbers(), map(is_not, reversed(old), reversed(groups))), shared)
        end = min(end, shared - start)
        olds, news = now[start : len(old) - end], groups[start : len(groups) - end]
        if len(olds) == len(news):
            both = zip(olds, news, strict=True)
            changed = [(request, group) for request, group in both if request.source is not group]
            if all(_activation(request.source) == _activation(group) for request, group in changed):
                return _RequestChanges([], [], changed, now)
        gone = {_activation(request.source): request for request in olds}
        if len(gone) < len(olds):
            return None
        changed, new, found, last = [], [], [], -1
        for group in news:
            request = gone.get(_activation(group))
            if request is None or request.label <= last:
                request = OrderedRequest(-1, group)
                new.append(request)
            else:
                del gone[_activation(group)]
                last = request.label
                if request.source is not group:
                    changed.append((request, group))
            found.append(request)
        now = [*now[:start], *found, *now[len(old) - end :]]
        for index in range(start, len(now)):
            now[index].index = index
        return _RequestChanges(list(gone.values()), new, changed, now)

    def _newcomers(self) -> dict[str, int]:
        """The robots that have joined since the last time, and their bits."""
        joined = self._bits.joined[self._joined :]
        self._joined = len(self._bits.joined)
        return {robot: bit for robot, bit in joined if self._bits.bit(robot) == bit}

    def _demand_changes(self, requests: Iterable[OrderedRequest]) -> list[DemandChange] | None:
        """The demands of these requests that are not as before; None: there are more, or fewer."""
        robots, changes = self._robots, []
        for request in requests:
            wanted = self._slots(request)
            if len(wanted) != len(request.groups):
                return None
            for group, (candidates, slots) in zip(request.groups, wanted, strict=True):
                if (group.pool.robots ^ candidates) & robots:
                    changes.append((group, candidates, slots))
                elif group.slots != slots:
                    changes.append((group, group.pool.robots, slots))
        return changes

    def _extended(
        self, changes: Sequence[DemandChange], newcomers: Mapping[str, int]
    ) -> dict[Pool, int]:
        """Pools of which all demands change in the same way: a newcomer is a candidate as well."""
        counts: dict[tuple[Pool, int], int] = {}
        for group, candidates, slots in changes if newcomers else ():
            before = group.pool.robots
            added = candidates & ~before
            is_added = (before | added) & self._robots == candidates & self._robots
            if is_added and group.slots == slots:
                counts[group.pool, added] = counts.get((group.pool, added), 0) + 1
        can_extend = self._decisions.matching.can_extend
        return {
            pool: added
            for (pool, added), count in counts.items()
            if added in newcomers.values() and can_extend(pool, added, count)
        }

    # -- pins ---------------------------------------------------------------------------------

    def _repin(
        self,
        changes: _RequestChanges,
        turned: Sequence[OrderedRequest],
        released: frozenset[str],
    ) -> None:
        """Bring `pins` up to date, and the demands of requests that have others."""
        changed = [request for request, _ in changes.changed]
        for request in [*changes.gone, *turned, *changed]:
            for demand in request.source:
                for robot in demand.pinned:
                    if self.pins.get(robot) is request:
                        del self.pins[robot]
                        self._held &= ~self._bits.bit(robot)
        for request, group in changes.changed:
            request.source = group
        for request in dict.fromkeys([*turned, *changed, *changes.new]):
            if request not in self._excluded:
                self._pin(request)
        if released != self.released or self._bits.all != self._robots:
            self._robots = self._bits.all
            self._held = self._bits.of([robot for robot in self.pins if robot not in released])

    def _pin(self, request: OrderedRequest) -> None:
        for demand in request.source:
            for robot in demand.pinned:
                if robot in self.pins:
                    raise SharedPinError
                self.pins[robot] = request
                if robot not in self.released:
                    self._held |= self._bits.bit(robot)

    # -- carrying it out ----------------------------------------------------------------------

    def _change_robots(
        self,
        newcomers: Mapping[str, int],
        extended: Mapping[Pool, int],
        changes: Sequence[DemandChange],
    ) -> None:
        decisions = self._decisions
        before, free = decisions.matching.free, self._robots & ~self._held
        for robot in _each(before & ~free):
            decisions.remove_robot(robot)
        for robot in _each(free & ~before):
            decisions.add_robot(robot)
        for robot in newcomers.values():
            sets = [candidates for _, candidates, _ in changes if candidates & robot]
            sets += [pool.robots | robot for pool, added in extended.items() if added == robot]
            decisions.introduce(robot, sets)
        for pool, robot in extended.items():
            decisions.matching.extend(pool, robot)

    def _decide(
        self,
        new: Sequence[OrderedRequest],
        turned: Sequence[OrderedRequest],
        changes: Sequence[DemandChange],
    ) -> None:
        decisions = self._decisions
        for request in turned:
            if request in self._excluded:
                decisions.exclude(request)
            else:
                decisions.make_due(request)
        for group, candidates, slots in changes:
            if candidates != group.pool.robots:
                decisions.set_candidates(group, candidates)
            if slots != group.slots:
                decisions.set_slots(group, slots)
        for request in new:
            decisions.add(request, self._slots(request))
            if request in self._excluded:
                request.excluded = True
            else:
                decisions.make_due(request)
        decisions.decide_due()


def _each(robots: int) -> Iterable[int]:
    while robots:
        robot = robots & -robots
        robots ^= robot
        yield robot


def _activation(group: Sequence[Demand]) -> str:
    return group[0].request.activation if group else ""


def _labelled(requests: Sequence[OrderedRequest], new: Sequence[OrderedRequest]) -> bool:
    """Give new requests labels between those of their neighbours; False: there is no room."""
    for request in new:
        before = requests[request.index - 1].label if request.index else -_GAP
        later = requests[request.index + 1 :]
        after = next((each.label for each in later if each.label >= 0), before + 2 * _GAP)
        request.label = (before + after) // 2
        if request.label <= max(before, -1):
            return False
    return True
