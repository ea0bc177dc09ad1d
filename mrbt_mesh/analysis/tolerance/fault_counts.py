"""How many faults a mission survives.

Computes the largest set of faults that it survives, the smallest set that is fatal, and the faults
that are fatal alone. Exact, with proofs of optimality; with a time limit, bounds instead.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

from mrbt_mesh.analysis.tolerance.model import Answer, FaultModel, Literal, optimum
from mrbt_mesh.analysis.tolerance.requirement import Formula, Requirement
from mrbt_mesh.analysis.tolerance.service import (
    Capability,
    Fault,
    FaultyTeam,
    JointNeed,
    Service,
    merged,
)
from mrbt_mesh.core.mission.mission import Mission, majority

MAX_NEEDS = 8


@dataclass(frozen=True)
class Reading:
    """A mission as one question sees it: its services, and which of them are required."""

    mission: Mission
    services: tuple[Service, ...]
    required: Requirement

    @cached_property
    def at_first(self) -> frozenset[int]:
        """The services that matter and are infeasible without faults."""
        return self.infeasible(FaultyTeam(self.mission))

    def infeasible(self, team: FaultyTeam) -> frozenset[int]:
        """Return the services that matter and that this team cannot perform."""
        return frozenset(
            each for each in self.required.services if not team.is_feasible(self.services[each])
        )

    def survives(self, team: FaultyTeam) -> bool:
        """Return whether the mission is not ruined: the definition, by the runtime's own check."""
        return not self.required.is_ruined(self.infeasible(team))

    @cached_property
    def is_feasible(self) -> bool:
        """True if the mission survives without faults."""
        return not self.required.is_ruined(self.at_first)

    @cached_property
    def relied_on(self) -> Mapping[int, frozenset[Fault]]:
        """What each feasible service that matters relies on without faults."""
        team = FaultyTeam(self.mission)
        found = {each: team.relies_on(self.services[each]) for each in self.required.services}
        return {each: used for each, used in found.items() if used is not None}

    def may_change(self, number: int, fault: Fault) -> bool:
        """Return whether a fault can make a difference to a service."""
        wanted = self.services[number]
        return fault in wanted.touched_by or (wanted.exclusive and isinstance(fault, str))

    def broken_by(self, fault: Fault) -> frozenset[int]:
        """Return the services that matter and are infeasible with one fault."""
        team = FaultyTeam(self.mission).with_faults(fault)
        changed = {
            each
            for each, used in self.relied_on.items()
            if fault in used and not team.is_feasible(self.services[each])
        }
        return self.at_first | changed

    def critical(self, faults: Sequence[Fault]) -> list[Fault]:
        """Return all faults that are fatal alone."""
        is_ruined = functools.cache(self.required.is_ruined)
        return [fault for fault in faults if is_ruined(self.broken_by(fault))]


@dataclass(frozen=True)
class Tolerance:
    """The results for one kind of fault.

    `max_tolerated` and `min_fatal` list the faults of one such set.
    """

    total: int
    max_tolerated: Answer
    min_fatal: Answer
    critical: tuple[Fault, ...]


def tolerance(reading: Reading, faults: Sequence[Fault], limit_s: float) -> Tolerance:
    """Analyse faults of one kind; `limit_s` is for each of the two questions to the solver."""
    if not reading.is_feasible:
        return Tolerance(len(faults), Answer(None, None, True), Answer(0, 0, True), ())
    critical = reading.critical(faults)
    only_one = Answer(1, 1, True, tuple(critical[:1]))
    fewest = only_one if critical else min_fatal(reading, faults, limit_s)
    return Tolerance(len(faults), max_tolerated(reading, faults, limit_s), fewest, tuple(critical))


def _relevant(reading: Reading, faults: Sequence[Fault]) -> list[Fault]:
    services = [reading.services[each] for each in reading.required.services]
    touched = frozenset[Fault]().union(*(each.touched_by for each in services))
    if any(each.exclusive for each in services):
        touched |= set(reading.mission.robots)
    return [fault for fault in faults if fault in touched]


# -- the most that is survived ----------------------------------------------------------------


def _greedy(reading: Reading, faults: Sequence[Fault]) -> tuple[Fault, ...]:
    """Choose faults one after another that the mission survives together with the previous ones.

    The capabilities that remain are spread over the robots, because a task needs different robots.
    """
    robots = sorted(reading.mission.robots)
    places = {robot: place for place, robot in enumerate(robots)}
    names = sorted({fault[1] for fault in faults if not isinstance(fault, str)})
    shifts = {name: 7 * place for place, name in enumerate(names)}

    def last_to_lose(fault: Fault) -> int:
        robot, shift = (fault, 0) if isinstance(fault, str) else (fault[0], shifts[fault[1]])
        return -((places[robot] - shift) % len(robots))

    team = FaultyTeam(reading.mission)
    relied_on = dict(reading.relied_on)
    chosen = []
    for fault in sorted(faults, key=lambda fault: (last_to_lose(fault), str(fault))):
        trial = team.with_faults(fault)
        changed = {
            each: trial.relies_on(reading.services[each])
            for each, used in relied_on.items()
            if fault in used
        }
        ended = {each for each, used in changed.items() if used is None}
        broken = set(reading.required.services) - set(relied_on) | ended
        if ended and reading.required.is_ruined(broken):
            continue
        chosen.append(fault)
        team = trial
        relied_on |= {each: used for each, used in changed.items() if used is not None}
        for each in ended:
            del relied_on[each]
    return tuple(chosen)


def max_tolerated(reading: Reading, faults: Sequence[Fault], limit_s: float) -> Answer:
    """Return the largest set of faults that the mission survives; the bound is from above.

    The model first has small sets of needs; sets that a solution violates are added.
    """
    deadline_s = time.monotonic() + limit_s
    relevant = _relevant(reading, faults)
    free = tuple(fault for fault in faults if fault not in set(relevant))
    if not relevant:
        return Answer(len(free), len(free), True, free)
    best = _greedy(reading, relevant)
    built = FaultModel(reading.services, relevant)
    excuses = built.keep(reading.required, sorted(reading.mission.robots))
    built.model.maximize(built.total)
    built.model.add(built.total >= len(best))
    built.hint(best)
    bound = len(relevant)
    while (left_s := deadline_s - time.monotonic()) > 0:
        answer, values = optimum(built.model, built.lost, left_s)
        bound = min(bound, answer.bound if answer.bound is not None else bound)
        if bound == len(best):
            break
        found = built.chosen(values)
        team = FaultyTeam(reading.mission).with_faults(*found)
        if values and reading.survives(team):
            best = max(best, found, key=len)
            if answer.is_proved:
                bound = len(best)
            break
        if not values:
            break
        _forbid(built, excuses, reading, team)
    chosen = tuple(fault for fault in faults if fault in {*best, *free})
    return Answer(len(chosen), bound + len(free), len(best) == bound, chosen)


def _forbid(
    built: FaultModel, excuses: Mapping[int, Literal], reading: Reading, team: FaultyTeam
) -> None:
    """Add the sets of needs that this team cannot meet, one for each service."""
    for each, excuse in excuses.items():
        needs = built.needs[each]
        if team.can_meet(needs):
            continue
        built.hold_set(each, tuple(team.overasked(needs)), excuse)


# -- the fewest that are fatal ----------------------------------------------------------------


def min_fatal(reading: Reading, faults: Sequence[Fault], limit_s: float) -> Answer:
    """Return the smallest set of faults that ruins the mission; the bound is from below.

    No value, and proved, means that not even all faults ruin it. The alternatives at the top of the
    requirement are examined one after another, the most promising first.
    """
    if reading.survives(FaultyTeam(reading.mission).with_faults(*faults)):
        return Answer(None, None, True)
    deadline_s = time.monotonic() + limit_s
    relevant = _relevant(reading, faults)
    formulas, ruin = reading.required.formulas, reading.required.ruin
    estimates = _estimates(reading, relevant)
    branches = _unique_branches(
        reading, sorted((estimates[p].least, p) for p in _branches(reading))
    )
    best = estimates[ruin].fatal
    bound = len(best)
    for least, part in branches:
        if least >= len(best) or len(estimates[part].fatal) == least:
            continue
        left_s = deadline_s - time.monotonic()
        if left_s <= 0:
            bound = min(bound, least)
            break
        built = FaultModel(reading.services, relevant)
        leasts = {formulas.terms[f].service: e.least for f, e in estimates.items()}
        built.ruin(Requirement(formulas, part), sorted(reading.mission.robots), leasts)
        built.model.add(built.total >= least)
        built.model.add(built.total < len(best))
        built.model.minimize(built.total)
        answer, values = optimum(built.model, built.lost, left_s)
        if values:
            best = built.chosen(values)
        if not answer.is_proved:
            bound = min(bound, max(least, answer.bound or 0))
    bound = min(bound, len(best))
    chosen = tuple(fault for fault in faults if fault in set(best))
    return Answer(len(chosen), bound, bound == len(chosen), chosen)


def _branches(reading: Reading) -> tuple[Formula, ...]:
    """Return the alternatives at the top of what ruins the mission."""
    term = reading.required.formulas.terms[reading.required.ruin]
    return term.parts if term.service < 0 and not term.is_all else (reading.required.ruin,)


@dataclass(frozen=True)
class _Estimate:
    """An estimate for a formula: at least `least` faults, `fatal` suffice, and only `touched`
    matter.
    """

    least: int
    fatal: tuple[Fault, ...]
    touched: frozenset[Fault]


def _estimates(reading: Reading, faults: Sequence[Fault]) -> dict[Formula, _Estimate]:
    """Return an estimate for each part of what ruins the mission."""
    team, is_major = FaultyTeam(reading.mission), isinstance(faults[0], str)
    formulas = reading.required.formulas
    found: dict[Formula, _Estimate] = {}
    for each in formulas.below(reading.required.ruin):
        term = formulas.terms[each]
        parts = [found[part] for part in term.parts]
        touched = frozenset[Fault]().union(*(part.touched for part in parts))
        if term.service >= 0:
            wanted = reading.services[term.service]
            touched = frozenset(f for f in faults if reading.may_change(term.service, f))
            if not touched and team.is_feasible(wanted):
                # No faults of this kind break it.
                found[each] = _Estimate(len(faults) + 1, tuple(faults), touched)
            elif team.is_feasible(wanted):
                single = fewest_to_break(team, wanted, is_major)
                found[each] = _Estimate(single.least, single.chosen, touched)
            else:
                found[each] = _Estimate(0, (), touched)
        elif term.is_all:
            # Disjoint parts must each lose their own faults.
            is_split = sum(len(part.touched) for part in parts) == len(touched)
            least = [part.least for part in parts]
            union = tuple(dict.fromkeys(fault for part in parts for fault in part.fatal))
            found[each] = _Estimate(sum(least) if is_split else max(least), union, touched)
        else:
            fatal = min((part.fatal for part in parts), key=len)
            found[each] = _Estimate(min(part.least for part in parts), fatal, touched)
    return found


def _unique_branches(
    reading: Reading, branches: Sequence[tuple[int, Formula]]
) -> list[tuple[int, Formula]]:
    """Omit single services that differ from another one only in their names."""
    seen = set()
    found = []
    for lower, part in branches:
        term = reading.required.formulas.terms[part]
        if term.service >= 0:
            service = reading.services[term.service]
            rows = [(tuple(sorted(n.entries.items())), n.count) for n in merged(service.needs)]
            key = (service.exclusive, tuple(sorted(rows)))
            if key in seen:
                continue
            seen.add(key)
        found.append((lower, part))
    return found


# -- the fewest that break one service, without a solver -----------------------------------------
# By Hall's theorem some set of its needs must end up with fewer able robots than it asks for, so
# for every set the robots that are cheapest to remove are counted. Removing a robot from a set of
# needs costs 1 for its death, else the number of capabilities that it must lose.


@dataclass(frozen=True)
class Breaking:
    """How a service breaks: at least `least` faults, and `chosen` suffice."""

    least: int
    chosen: tuple[Fault, ...]


def fewest_to_break(team: FaultyTeam, wanted: Service, is_major: bool) -> Breaking:
    """Return the fewest faults of one kind that make a feasible service infeasible.

    With more than `MAX_NEEDS` different needs, `chosen` may have more than `least`.
    """
    needs = merged(wanted.needs, is_major)
    choices = []
    if len(needs) > MAX_NEEDS:
        _, tight = team.tightest(needs)
        choices.append(_cheapest([needs[index] for index in tight], is_major))
    else:
        for size in range(1, len(needs) + 1):
            for subset in combinations(needs, size):
                choices.append(_cheapest(subset, is_major))
    if wanted.exclusive and is_major:
        robots = sorted(team.mission.robots)
        choices.append(tuple(robots[: len(robots) - majority(robots) + 1]))
    best = min(choices, key=len)
    if len(needs) > MAX_NEEDS:
        # No fault removes more than one robot from a set of needs.
        return Breaking(team.slack(wanted) + 1, best)
    return Breaking(len(best), best)


def _cheapest(subset: Sequence[JointNeed], is_major: bool) -> tuple[Fault, ...]:
    """Return the fewest faults that leave these needs one robot short."""
    able = sorted({robot for need in subset for robot in need.entries})
    too_many = len(able) - sum(need.count for need in subset) + 1
    if is_major:
        return tuple(able[:too_many])
    costs = sorted(
        (
            removal(tuple(need.entries[robot] for need in subset if robot in need.entries))
            for robot in able
        ),
        key=lambda entries: (len(entries), entries),
    )
    return tuple(entry for entries in costs[:too_many] for entry in entries)


def removal(ways: tuple[tuple[Capability, ...], ...]) -> tuple[Capability, ...]:
    """Return the fewest capabilities that hit every one of these ways."""
    forced = {way[0] for way in ways if len(way) == 1}
    open_ways = {way for way in ways if forced.isdisjoint(way)}
    entries = sorted({entry for way in open_ways for entry in way})
    for size in range(len(entries) + 1):
        for extra in combinations(entries, size):
            if all(not set(extra).isdisjoint(way) for way in open_ways):
                return tuple(sorted({*forced, *extra}))
    raise AssertionError("all entries together hit every way")
