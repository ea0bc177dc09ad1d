"""*Check Consistency*: which requests can be served together, and why others cannot be at all.

Requests are taken in tree order; one is kept if all kept so far stay feasible: if every lower
bound can be met by different robots. Source: paper, section V, T_A.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Protocol, TypeAlias

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.feature import Limits
from mrbt_mesh.core.planning.capabilities import Capabilities, RobotMasks
from mrbt_mesh.core.planning.demands import Demand
from mrbt_mesh.core.planning.plan import Shortage

# (indices of the requests that are kept, robot -> request for the pins that hold)
Kept: TypeAlias = tuple[list[int], dict[str, int]]


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


class LimitCheck(Feasibility, Protocol):
    """The same within limits on which robots may work together; it can name these."""

    def obstacle(self, demands: Sequence[Demand]) -> str:
        """Which limits keep any living robots from serving a request; empty if none do."""
        ...

    def in_the_way(self, kept: Sequence[int], key: int, pinned: Mapping[str, int]) -> str:
        """Which limits keep request `key` from being kept with others; empty if none do."""
        ...


def feasibility(
    limits: Limits | None,
    robots: Iterable[str],
    demands: Sequence[Sequence[Demand]],
    masks: RobotMasks | None = None,
) -> Feasibility:
    """What decides which of the requests with these demands can be kept."""
    return Consistency(robots, masks) if limits is None else limits.check(list(robots), demands)


class Consistency:
    """Feasible: every lower bound can be met by different robots.

    It is a matching of slots (one per robot that a lower bound still needs) to free robots, grown
    by augmenting paths (Berge); a request whose slots do not all fit is taken back whole. A search
    without a path has reached robots that all serve slots which only these robots could serve
    (Hall). That remains so, since what is kept stays: a slot for them alone fails at once.
    """

    def __init__(self, team: Iterable[str], masks: RobotMasks | None = None) -> None:
        robots = sorted(team)
        self._masks = masks or RobotMasks(robots)
        self._team = self._free = self._masks.of(robots)
        self._pinned: Mapping[str, int] = {}
        # By slot: its request, the robots that could serve it, and the one that does.
        self._keys: list[int] = []
        self._wanted: list[int] = []
        self._served_by: list[int] = []
        # Robot -> slot; robots by their numbers.
        self._owner: dict[int, int] = {}
        self._taken = 0
        self._serves_kept = True
        # Number -> robots that can serve no more slots than that beside those that are kept.
        self._full: dict[int, int] = {}

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Try to add request `key`; `pinned` maps robots to the request that they run.

        That mapping must not be changed afterwards.
        """
        if pinned is not self._pinned:
            self._follow(pinned)
        if not self._serves_kept:
            return False
        first = len(self._keys)
        for demand in demands:
            needed = demand.lower - sum(pinned.get(robot) == key for robot in demand.pinned)
            if needed <= 0:
                continue
            able = self._masks.of(demand.candidates) & self._team
            others = able & self._free
            if any(needed > spare and not others & ~full for spare, full in self._full.items()):
                self._take_back(first)
                return False
            for _ in range(needed):
                reached = self._add(key, able)
                if reached is not None:
                    self._note_full(reached, first)
                    self._take_back(first)
                    return False
        return True

    def _follow(self, pinned: Mapping[str, int]) -> None:
        """Other robots are free now: what is kept is matched anew."""
        self._pinned, self._free = pinned, self._team & ~self._masks.of(pinned)
        self._full.clear()
        kept = zip(self._keys, self._wanted, strict=True)
        self._keys, self._wanted, self._served_by = [], [], []
        self._owner, self._taken = {}, 0
        unserved = [slot for slot in kept if self._add(*slot) is not None]
        self._serves_kept = not unserved

    @property
    def matched(self) -> dict[str, int]:
        """Robot -> the request that it is kept for."""
        robots = self._masks.robots
        return {robots[number]: self._keys[slot] for number, slot in self._owner.items()}

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Whether `keep` would succeed."""
        first = len(self._keys)
        fits = self.keep(key, demands, pinned)
        self._take_back(first)
        return fits

    def _add(self, key: int, able: int) -> int | None:
        """Give a new slot a robot; others change slots where that frees one.

        None if it has one, else all robots that were reached.
        """
        queue = [len(self._keys)]
        self._keys.append(key)
        self._wanted.append(able)
        self._served_by.append(-1)
        seen, wanted_by = 0, dict[int, int]()
        for seeker in queue:
            fresh = self._wanted[seeker] & self._free & ~seen
            if unused := fresh & ~self._taken:
                robot = (unused & -unused).bit_length() - 1
                self._taken |= 1 << robot
                wanted_by[robot] = seeker
                while robot >= 0:
                    slot = wanted_by[robot]
                    self._owner[robot] = slot
                    robot, self._served_by[slot] = self._served_by[slot], robot
                return None
            seen |= fresh
            while fresh:
                robot = (fresh & -fresh).bit_length() - 1
                fresh &= fresh - 1
                wanted_by[robot] = seeker
                queue.append(self._owner[robot])
        return seen

    def _note_full(self, robots: int, first: int) -> None:
        """Slots from `first` on are taken back: that many more can be served by these robots."""
        spare = sum(
            robots >> self._served_by[slot] & 1 for slot in range(first, len(self._keys) - 1)
        )
        self._full[spare] = robots | self._full.get(0, 0)

    def _take_back(self, first: int) -> None:
        """Remove the slots from `first` on."""
        for robot in self._served_by[first:]:
            if robot >= 0:
                self._taken ^= 1 << robot
                del self._owner[robot]
        del self._keys[first:], self._wanted[first:], self._served_by[first:]


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
            left = {other: held for other, held in left.items() if other != robot}
            freed.append(robot)
            if check.fits(index, group, left):
                break
    else:
        return None
    for robot in reversed(freed[:-1]):
        again = left | {robot: pinned[robot]}
        if check.fits(index, group, again):
            left = again
    check.keep(index, group, left)
    return left


def shortages(
    facts: TeamFacts, group: Sequence[Demand], capabilities: Capabilities
) -> tuple[Shortage, ...]:
    """What makes a request *blocked*: no set of living robots could serve it, busy or not.

    Empty if it is not blocked. Where each local task alone could be met but not all together,
    every one of them is listed.
    """
    if could_be_met(group, capabilities.team):
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


def could_be_met(group: Sequence[Demand], team: Collection[str]) -> bool:
    """Whether one request could be served if all robots were free."""
    needed = sum(demand.lower for demand in group)
    # Demands with as many candidates as the whole request needs can be met last.
    few = [d for d in group if d.lower and not _has(d.candidates, team, needed)]
    if len(few) < 2:
        return all(_has(d.candidates, team, d.lower) for d in few)
    able = dict.fromkeys(r for demand in few for r in demand.candidates if r in team)
    return Consistency(able).keep(0, few, {})


def _has(candidates: Collection[str], team: Collection[str], count: int) -> bool:
    """Whether `count` of the candidates are in the team."""
    if len(candidates) < count:
        return False
    for robot in candidates:
        if count <= 0:
            break
        count -= robot in team
    return count <= 0
