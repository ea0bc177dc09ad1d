"""*Check Consistency*: which requests can be served together, and why others cannot be at all.

Requests are taken in tree order; one is kept if all kept so far stay feasible: if every lower
bound can be met by different robots. Source: paper, section V, T_A.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Protocol, TypeAlias

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.capabilities import Capabilities
from mrbt_mesh.core.planning.demands import Demand
from mrbt_mesh.core.planning.plan import Shortage

# (indices of the requests that are kept, robot -> request for the pins that hold)
Kept: TypeAlias = tuple[list[int], dict[str, int]]
# One robot that a lower bound still needs: (request, number).
Slot: TypeAlias = tuple[int, int]


class Feasibility(Protocol):
    """Keeps requests one after the other while all stay feasible together.

    `pinned` maps robots to the request that they run; they are not free for others.
    """

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Try to add request `key`."""
        ...

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Whether `keep` would succeed."""
        ...


class Consistency:
    """Feasible: every lower bound can be met by different robots.

    It is a matching of slots (one per robot that a lower bound still needs) to free robots, grown
    by augmenting paths (Berge); a request whose slots do not all fit is taken back whole.
    """

    def __init__(self, free: Iterable[str]) -> None:
        self._free = sorted(free)
        self._owner: dict[str, Slot] = {}
        self._matched: dict[Slot, str] = {}
        self._candidates: dict[Slot, list[str]] = {}

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Try to add request `key`; `pinned` maps robots to the request that they run."""
        before = dict(self._owner), dict(self._matched)
        slots = 0
        for demand in demands:
            own = sum(1 for robot in demand.pinned if pinned.get(robot) == key)
            able = [robot for robot in self._free if robot in demand.candidates]
            for _ in range(demand.lower - own):
                slot = (key, slots)
                slots += 1
                self._candidates[slot] = able
                if not self._augment(slot, pinned):
                    self._owner, self._matched = before
                    return False
        return True

    @property
    def matched(self) -> dict[str, int]:
        """Robot -> the request that it is kept for."""
        return {robot: key for robot, (key, _) in self._owner.items()}

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Whether `keep` would succeed."""
        before = dict(self._owner), dict(self._matched)
        kept = self.keep(key, demands, pinned)
        self._owner, self._matched = before
        return kept

    def _augment(self, slot: Slot, pinned: Mapping[str, int]) -> bool:
        """Give `slot` a robot; others change slots where that frees one."""
        wanted_by: dict[str, Slot] = {}
        queue = [slot]
        for seeker in queue:
            for robot in self._candidates[seeker]:
                if robot in wanted_by or robot in pinned:
                    continue
                wanted_by[robot] = seeker
                if robot in self._owner:
                    queue.append(self._owner[robot])
                else:
                    self._hand_over(robot, wanted_by)
                    return True
        return False

    def _hand_over(self, robot: str, wanted_by: Mapping[str, Slot]) -> None:
        """Match the free `robot`, its new slot's robot one further, and so on."""
        free: str | None = robot
        while free is not None:
            slot = wanted_by[free]
            previous = self._matched.get(slot)
            self._owner[free], self._matched[slot] = slot, free
            free = previous


def kept_requests(
    facts: TeamFacts,
    demands: Sequence[Sequence[Demand]],
    begin: Callable[[], Feasibility],
    excluded: Collection[int] = (),
) -> Kept:
    """Which requests are kept, and which pins hold; the pins are sorted by robot.

    `begin`: what decides, with nothing kept. `excluded` requests are not kept, whatever is free.
    A preemptive request may take running robots from requests further right.
    """
    pinned = {
        robot: index
        for index, group in enumerate(demands)
        for demand in group
        for robot in demand.pinned
        if index not in excluded
    }
    return with_yielding_pins(pinned, lambda pins: _keep(facts, demands, begin(), pins, excluded))


def with_yielding_pins(pinned: dict[str, int], keep: Callable[[dict[str, int]], Kept]) -> Kept:
    """A pin whose own request cannot be kept yields, if some other request then can be.

    `keep`: what is kept with such pins, and which of them hold. Of two sets of requests the one
    that is first in tree order is better. A robot whose yielding helps nobody goes on.
    """
    kept, held = keep(pinned)
    served = set(kept)
    unserved = sorted(robot for robot, index in held.items() if index not in served)
    if unserved:
        holding = {robot: index for robot, index in held.items() if index in served}
        better, held_then = keep(holding)
        if is_better(better, kept):
            for robot in unserved:
                again = holding | {robot: held[robot]}
                kept_now, held_now = keep(again)
                if kept_now == better:
                    holding, held_then = again, held_now
            kept, held = better, held_then
    return kept, {robot: held[robot] for robot in sorted(held)}


def is_better(kept: Sequence[int], other: Sequence[int]) -> bool:
    """Of two sets of requests (sorted) the one that has the first they differ in is better."""
    for index, theirs in zip(kept, other, strict=False):
        if index != theirs:
            return index < theirs
    return len(kept) > len(other)


def _keep(
    facts: TeamFacts,
    demands: Sequence[Sequence[Demand]],
    check: Feasibility,
    pins: Mapping[str, int],
    excluded: Collection[int],
) -> Kept:
    kept: list[int] = []
    pinned = dict(pins)
    for index, group in enumerate(demands):
        if index in excluded:
            continue
        if check.keep(index, group, pinned):
            kept.append(index)
        elif facts.mission.global_tasks[group[0].request.subject].preemptive:
            freed = _preempt(check, index, group, pinned)
            if freed is not None:
                pinned = freed
                kept.append(index)
    return kept, pinned


def _preempt(
    check: Feasibility, index: int, group: Sequence[Demand], pinned: Mapping[str, int]
) -> dict[str, int] | None:
    """Free robots of requests further right, rightmost first, until `index` can be kept.

    Those that turn out not to be needed go on.
    """
    left = dict(pinned)
    freed: list[str] = []
    for robot in sorted(pinned, key=lambda robot: (-pinned[robot], robot)):
        if pinned[robot] > index:
            del left[robot]
            freed.append(robot)
            if check.fits(index, group, left):
                break
    else:
        return None
    for robot in reversed(freed[:-1]):
        if check.fits(index, group, left | {robot: pinned[robot]}):
            left[robot] = pinned[robot]
    check.keep(index, group, left)
    return left


def shortages(
    facts: TeamFacts, group: Sequence[Demand], capabilities: Capabilities
) -> tuple[Shortage, ...]:
    """What makes a request *blocked*: no set of living robots could serve it, busy or not.

    Empty if it is not blocked. Where each local task alone could be met but not all together,
    every one of them is listed.
    """
    if _could_be_met(group, capabilities.team):
        return ()

    def shortage(demand: Demand) -> Shortage:
        results = facts.results(demand.request.activation, demand.local_task)
        able = capabilities.able(demand.local_task)
        alive = len(able)
        if demand.after:
            alive = len(demand.candidates.keys() | (able.keys() & results.keys()))
        done = sum(results.values())
        failed = len(results) - done
        return Shortage(demand.local_task, demand.needed, alive, done, failed, demand.after)

    short = [demand for demand in group if len(demand.candidates) < demand.lower]
    return tuple(shortage(demand) for demand in short or [d for d in group if d.lower])


def _could_be_met(group: Sequence[Demand], team: Collection[str]) -> bool:
    """Whether one request could be served if all robots were free."""
    needed = sum(demand.lower for demand in group)
    # Demands with as many candidates as the whole request needs can be met last.
    few = [d for d in group if d.lower and not _has(d.candidates, team, needed)]
    if len(few) < 2:
        return all(_has(d.candidates, team, d.lower) for d in few)
    able = dict.fromkeys(r for demand in few for r in demand.candidates if r in team)
    return Consistency(able).keep(0, few, {})


def _has(candidates: Collection[str], team: Collection[str], count: int) -> bool:
    """Whether so many of the candidates are in the team."""
    if len(candidates) < count:
        return False
    for robot in candidates:
        if count <= 0:
            break
        count -= robot in team
    return count <= 0
