"""*Check Consistency* written down plainly: the reference for the fast one in the core.

Keeps requests one after the other while every lower bound can be met by different robots, by
augmenting paths from scratch.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TypeAlias

from mrbt_mesh.core.capable import Worker
from mrbt_mesh.core.demand import Demand
from mrbt_mesh.core.team import TeamFacts

Slot: TypeAlias = tuple[int, int]


class Consistency:
    """*Check Consistency*: keeps requests one after the other while all stay feasible together.

    Feasible means that every lower bound can be met by different robots. It is a matching of
    slots (one per robot that a lower bound still needs) to free robots, grown by augmenting
    paths; a request whose slots do not all fit is taken back whole.
    """

    def __init__(self, free: Iterable[str]) -> None:
        self._free = sorted(free)
        self._owner: dict[str, Slot] = {}
        self._seat: dict[Slot, str] = {}
        self._candidates: dict[Slot, list[str]] = {}

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Try to add request `key`; `pinned` maps robots to the request that they run."""
        before = dict(self._owner), dict(self._seat)
        slots = 0
        for demand in demands:
            own = sum(1 for robot in demand.pinned if pinned.get(robot) == key)
            able = [robot for robot in self._free if robot in demand.candidates]
            for _ in range(demand.lower - own):
                slot = (key, slots)
                slots += 1
                self._candidates[slot] = able
                if not self._augment(slot, pinned):
                    self._owner, self._seat = before
                    return False
        return True

    @property
    def seated(self) -> dict[str, int]:
        """Robot -> the request that it is kept for."""
        return {robot: key for robot, (key, _) in self._owner.items()}

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Whether `keep` would succeed."""
        before = dict(self._owner), dict(self._seat)
        kept = self.keep(key, demands, pinned)
        self._owner, self._seat = before
        return kept

    def _augment(self, slot: Slot, pinned: Mapping[str, int]) -> bool:
        """Give `slot` a robot; others change seats where that frees one."""
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
        """Seat the free `robot`, its new owner's robot one further, and so on."""
        free: str | None = robot
        while free is not None:
            slot = wanted_by[free]
            previous = self._seat.get(slot)
            self._owner[free], self._seat[slot] = slot, free
            free = previous


def kept_requests(
    facts: TeamFacts,
    demands: Sequence[Sequence[Demand]],
    team: Mapping[str, Worker],
    barred: Collection[int] = (),
) -> tuple[list[int], dict[str, int]]:
    """(indices of the requests that are kept, robot -> request for the pins that hold).

    `barred` requests are not kept, whatever is free.

    A pin whose own request cannot be kept yields, if some other request then can; of two
    sets of requests the one that is first in tree order is better. A preemptive request may
    take running robots from requests further right.
    """
    pinned = {
        robot: index
        for index, group in enumerate(demands)
        for demand in group
        for robot in demand.pinned
        if index not in barred
    }
    kept, pinned = _keep(facts, demands, team, pinned, barred)
    holding = {robot: index for robot, index in pinned.items() if index in kept}
    vain = {robot: index for robot, index in pinned.items() if robot not in holding}
    kept_after, pinned_after = (
        _keep(facts, demands, team, holding, barred) if vain else (kept, pinned)
    )
    count = range(len(demands))
    if [i in kept_after for i in count] <= [i in kept for i in count]:
        return kept, pinned
    for robot in sorted(vain):  # who helps nobody goes on
        kept_now, pinned_now = _keep(facts, demands, team, holding | {robot: vain[robot]}, barred)
        if kept_now == kept_after:
            holding[robot] = vain[robot]
            pinned_after = pinned_now
    return kept_after, pinned_after


def _keep(
    facts: TeamFacts,
    demands: Sequence[Sequence[Demand]],
    team: Mapping[str, Worker],
    pinned: dict[str, int],
    barred: Collection[int],
) -> tuple[list[int], dict[str, int]]:
    kept: list[int] = []
    pinned = dict(pinned)
    check = Consistency(team)
    for index, group in enumerate(demands):
        if index in barred:
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
    check: Consistency, index: int, group: Sequence[Demand], pinned: Mapping[str, int]
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
