"""*Check Consistency*: which requests can be served together, and why others cannot be at all.

Requests are taken in tree order; one is kept if all kept so far stay feasible: if every lower
bound can be met by different robots. Source: paper, section IV, T_A.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from mrbt_mesh.core.capable import Capable, Worker
from mrbt_mesh.core.demand import Demand
from mrbt_mesh.core.robot_bits import RobotBits
from mrbt_mesh.core.seating import Seating
from mrbt_mesh.core.seats import Row
from mrbt_mesh.core.standing import Groups, SharedPinError, Standing
from mrbt_mesh.core.team import TeamFacts


class Consistency:
    """Keeps requests one after the other while all stay feasible together."""

    def __init__(self, free: Iterable[str]) -> None:
        self._bits = RobotBits(sorted(free))
        self._seating = Seating(self._bits.all)

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Try to add request `key`; `pinned` maps robots to the request that they run."""
        self.bind(pinned)
        return self.decide(key, demands, pinned)

    def decide(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """`keep` with the robots bound that were bound last: those in `pinned`."""
        return self._seating.decide(self._row(key, demands, pinned))

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Whether `keep` would succeed."""
        self.bind(pinned)
        row = self._row(key, demands, pinned)
        fits = self._seating.fits(row)
        self._seating.remove_row(row)
        return fits

    def bind(self, pinned: Collection[str]) -> None:
        """These robots are not free."""
        free = self._bits.all & ~self._bits.of(pinned) if pinned else self._bits.all
        if free != self._seating.free:
            self._seating.set_free(free)

    @property
    def seated(self) -> dict[str, int]:
        """Robot -> the request that it is kept for."""
        found = self._seating.seated()
        return {robot: found[bit] for robot, bit in self._bits.joined if bit in found}

    def _row(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> Row:
        row = Row(len(self._seating.rows), key)
        asks = []
        for demand in demands:
            own = sum(1 for robot in demand.pinned if pinned.get(robot) == key)
            asks.append((self._bits.mask(demand.candidates), max(0, demand.lower - own)))
        self._seating.add_row(row, asks)
        return row


class Keeping(Protocol):
    """Keeps requests one after the other while all stay feasible together."""

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool: ...
    def decide(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool: ...
    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool: ...
    def bind(self, pinned: Collection[str]) -> None: ...


def kept_one_by_one(
    facts: TeamFacts,
    demands: Sequence[Sequence[Demand]],
    begin: Callable[[], Keeping],
    barred: Collection[int],
) -> tuple[list[int], dict[str, int]]:
    """`kept_requests` where requests may take robots from others: all of it again for each pin
    that may have to yield. `begin`: what decides, with nothing kept.
    """
    pinned = {
        robot: index
        for index, group in enumerate(demands)
        for demand in group
        for robot in demand.pinned
        if index not in barred
    }
    kept, pinned = _keep(facts, demands, begin(), pinned, barred)
    served = set(kept)
    holding = {robot: index for robot, index in pinned.items() if index in served}
    vain = {robot: index for robot, index in pinned.items() if robot not in holding}
    if not vain:
        return kept, pinned
    kept_after, pinned_after = _keep(facts, demands, begin(), holding, barred)
    if not is_better(kept_after, kept):
        return kept, pinned
    for robot in sorted(vain):  # who helps nobody goes on
        kept_now, pinned_now = _keep(
            facts, demands, begin(), holding | {robot: vain[robot]}, barred
        )
        if kept_now == kept_after:
            holding[robot] = vain[robot]
            pinned_after = pinned_now
    return kept_after, pinned_after


def is_better(kept: Sequence[int], other: Sequence[int]) -> bool:
    """Of two sets of requests (sorted) the one that has the first they differ in is better."""
    for index, theirs in zip(kept, other, strict=False):
        if index != theirs:
            return index < theirs
    return len(kept) > len(other)


def _keep(
    facts: TeamFacts,
    demands: Sequence[Sequence[Demand]],
    check: Keeping,
    pinned: dict[str, int],
    barred: Collection[int],
) -> tuple[list[int], dict[str, int]]:
    kept: list[int] = []
    pinned = dict(pinned)
    check.bind(pinned)
    for index, group in enumerate(demands):
        if index in barred:
            continue
        if check.decide(index, group, pinned):
            kept.append(index)
        elif facts.mission.global_tasks[group[0].request.subject].preemptive:
            freed = _preempt(check, index, group, pinned)
            if freed is not None:
                pinned = freed
                kept.append(index)
    return kept, pinned


def _preempt(
    check: Keeping, index: int, group: Sequence[Demand], pinned: Mapping[str, int]
) -> dict[str, int] | None:
    """Free robots of requests further right, rightmost first, until `index` can be kept.

    Those that turn out not to be needed go on.
    """
    order = sorted(pinned, key=lambda robot: (-pinned[robot], robot))
    order = [robot for robot in order if pinned[robot] > index]

    def left(count: int) -> dict[str, int]:
        freed = set(order[:count])
        return {robot: at for robot, at in pinned.items() if robot not in freed}

    if not order or not check.fits(index, group, left(len(order))):
        check.bind(pinned)
        return None
    few, many = 0, len(order)  # the more are freed, the better it fits
    while many - few > 1:
        middle = (few + many) // 2
        if check.fits(index, group, left(middle)):
            many = middle
        else:
            few = middle
    rest = left(many)
    for robot in reversed(order[: many - 1]):
        if check.fits(index, group, rest | {robot: pinned[robot]}):
            rest[robot] = pinned[robot]
    check.keep(index, group, rest)
    return rest


class ConsistencyKeeper:
    """*Check Consistency* for one plan after the other: what has not changed is not done again.

    Groups of demands, and candidates, that are the same objects as before must not have changed.
    """

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._bits = RobotBits()
        self._standing = Standing(self._bits)

    def kept_requests(
        self,
        facts: TeamFacts,
        demands: Groups,
        team: Mapping[str, Worker],
        barred: Collection[int] = (),
    ) -> tuple[list[int], dict[str, int]]:
        """As the function `kept_requests`; the pins are sorted by robot."""
        self._bits.set(team)
        if self._bits.count > 2 * len(team) + 64:
            self._forget()
            self._bits.set(team)
        try:
            found = self._plain(facts, demands, barred)
        except SharedPinError:
            self._forget()
            found = None
        if found is None:
            kept, pinned = kept_one_by_one(facts, demands, lambda: Consistency(team), barred)
            return kept, {robot: pinned[robot] for robot in sorted(pinned)}
        return found

    def _plain(
        self, facts: TeamFacts, demands: Groups, barred: Collection[int]
    ) -> tuple[list[int], dict[str, int]] | None:
        """None if a request might take robots from others."""
        standing = self._standing
        standing.update(demands, barred, frozenset())
        if _might_preempt(facts, standing):
            return None
        kept, pins = standing.kept, standing.pins
        vain = frozenset(robot for robot, row in pins.items() if not row.kept)
        yielding: set[str] = set()
        if vain and standing.would_matter(vain):
            standing.update(demands, barred, vain)
            if _might_preempt(facts, standing):
                return None
            if is_better(standing.kept, kept):
                kept, yielding = standing.kept, set(vain)
                for robot in sorted(vain):  # who helps nobody goes on
                    standing.update(demands, barred, frozenset(yielding - {robot}))
                    if _might_preempt(facts, standing):
                        return None
                    if standing.kept == kept:
                        yielding.discard(robot)
        return list(kept), {r: pins[r].index for r in sorted(pins) if r not in yielding}


def _might_preempt(facts: TeamFacts, standing: Standing) -> bool:
    """Whether a request that is not kept may take robots from others further right."""
    if not facts.mission.has_preemptive:
        return False
    tasks = facts.mission.global_tasks
    last = max((row.index for row in standing.pins.values()), default=-1)
    return any(
        not row.kept and row.wanted and tasks[row.source[0].request.subject].preemptive
        for row in standing.rows[: last + 1]
    )


def kept_requests(
    facts: TeamFacts,
    demands: Groups,
    team: Mapping[str, Worker],
    barred: Collection[int] = (),
) -> tuple[list[int], dict[str, int]]:
    """(indices of the requests that are kept, robot -> request for the pins that hold).

    `barred` requests are not kept, whatever is free.

    A pin whose own request cannot be kept yields, if some other request then can; of two
    sets of requests the one that is first in tree order is better. A preemptive request may
    take running robots from requests further right.
    """
    return ConsistencyKeeper().kept_requests(facts, demands, team, barred)


@dataclass(frozen=True, slots=True)
class Shortage:
    """A local task that lacks robots: nu, living capable robots, outcomes so far.

    `after`: what they have to have done before.
    """

    local_task: str
    needed: int
    alive: int
    done: int
    failed: int
    after: str = ""

    def __str__(self) -> str:
        text = f"{self.local_task} needs {self.needed}{self.after}, {self.alive} alive"
        counts = ((self.done, "done"), (self.failed, "failed"))
        return text + "".join(f", {count} {what}" for count, what in counts if count)


def shortages(facts: TeamFacts, group: Sequence[Demand], capable: Capable) -> tuple[Shortage, ...]:
    """What makes a request *blocked*: no set of living robots could serve it, busy or not.

    Empty if it is not blocked. Where each local task alone could be met but not all together,
    every one of them is listed.
    """
    if _could_be_met(group, capable.team):
        return ()

    def shortage(demand: Demand) -> Shortage:
        results = facts.results(demand.request.activation, demand.local_task)
        able = capable.able(demand.local_task)
        alive = len(able)
        if demand.after:
            alive = len(demand.candidates.keys() | (able.keys() & results.keys()))
        done = sum(results.values())
        failed = len(results) - done
        return Shortage(demand.local_task, demand.needed, alive, done, failed, demand.after)

    short = [demand for demand in group if len(demand.candidates) < demand.lower]
    return tuple(shortage(demand) for demand in short or group)


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
