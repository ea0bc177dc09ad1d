"""The parts of the optimisation models (CP-SAT): services that hold, services that break, trees.

Both rest on Hall's theorem: a service is feasible if every set of its needs finds as many robots,
able to do one of them, as the set asks for. So a service *holds* by a constraint per set of needs
(those that matter are added while solving), and *breaks* by one set for which it fails.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, TypeAlias

from ortools.sat.python import cp_model

from mrbt_mesh.analysis.tolerance.requirement import ALWAYS, NEVER, Requirement
from mrbt_mesh.analysis.tolerance.service import Capability, Fault, JointNeed, Service, merged
from mrbt_mesh.core.mission.mission import majority

Literal: TypeAlias = Any  # ortools has no type for "a Boolean variable or its negation"
Subset: TypeAlias = tuple[int, ...]  # of the merged needs of a service
SEED = 1
MAX_NEEDS_IN_FULL = 6


@dataclass(frozen=True)
class Answer:
    """The result of a solver. `value` is None if there is no solution.

    `bound`: no solution is better than this; equal to `value` if it is proved optimal. `is_proved`:
    the answer, or that there is none, is certain.
    """

    value: int | None
    bound: int | None
    is_proved: bool
    chosen: tuple[Any, ...] = ()


class FaultModel:
    """Which faults of one kind happen, as a count for each group of interchangeable faults.

    Robots with the same abilities are interchangeable, capabilities are not.
    """

    def __init__(self, services: Sequence[Service], faults: Sequence[Fault]) -> None:
        self.model = cp_model.CpModel()
        self.services = services
        is_major = any(isinstance(fault, str) for fault in faults)
        self.needs = [merged(each.needs, is_major) for each in services]
        self.groups: dict[Fault, tuple[Fault, ...]] = {}
        self._group_of: dict[Fault, Fault] = {}
        self.lost: dict[Fault, Literal] = {}
        self._outs: dict[tuple[bool, str, tuple[tuple[Capability, ...], ...]], Literal] = {}
        self._group(faults)
        self.total = sum(self.lost.values())

    def _group(self, faults: Sequence[Fault]) -> None:
        alike: dict[Any, list[Fault]] = {}
        for fault in faults:
            key: Any = fault
            if isinstance(fault, str):
                key = tuple(tuple(fault in need.entries for need in needs) for needs in self.needs)
            alike.setdefault(key, []).append(fault)
        for members in alike.values():
            first = members[0]
            self.groups[first] = tuple(members)
            self._group_of.update(dict.fromkeys(members, first))
            self.lost[first] = (
                self.model.new_bool_var(str(first))
                if len(members) == 1
                else self.model.new_int_var(0, len(members), str(first))
            )

    def hint(self, happened: Iterable[Fault]) -> None:
        """Hint this choice to the solver."""
        known = set(happened)
        for first, members in self.groups.items():
            self.model.add_hint(self.lost[first], len(known & set(members)))

    def chosen(self, values: Mapping[Fault, int]) -> tuple[Fault, ...]:
        """Return the faults of a solution."""
        return tuple(f for first, n in values.items() for f in self.groups[first][:n])

    # -- sets of needs ------------------------------------------------------------------------

    def _room(self, service: int, subset: Subset) -> tuple[int, set[str]]:
        """Return how many able robots a set of needs can spare, and the able robots."""
        needs = [self.needs[service][index] for index in subset]
        able = {robot for need in needs for robot in need.entries}
        return len(able) - sum(need.count for need in needs), able

    def _gone(self, service: int, subset: Subset, able: set[str], is_break: bool) -> Any:
        """Return how many robots can no longer do any of a set of needs.

        The count is at least the true number if the service is to hold, at most if it is to break.
        """
        if any(robot in self._group_of for robot in able):
            return sum(self.lost[first] for first in self.groups if first in able)
        needs = [self.needs[service][index] for index in subset]
        terms = []
        for robot in sorted(able):
            ways = tuple(dict.fromkeys(n.entries[robot] for n in needs if robot in n.entries))
            if all(any(entry in self.lost for entry in entries) for entries in ways):
                terms.append(self._out(robot, ways, is_break))
        return sum(terms)

    def _out(self, robot: str, ways: tuple[tuple[Capability, ...], ...], is_break: bool) -> Literal:
        """Return a literal: a robot has lost every one of these ways."""
        losses = [[self.lost[entry] for entry in way if entry in self.lost] for way in ways]
        if len(losses) == 1 and len(losses[0]) == 1:
            return losses[0][0]
        key = (is_break, robot, ways)
        if key not in self._outs:
            out = self._outs[key] = self.model.new_bool_var("")
            if is_break:
                for one in losses:
                    self.model.add_bool_or([out.negated(), *one])
            else:
                ended = []
                for one in losses:
                    way = one[0] if len(one) == 1 else self.model.new_bool_var("")
                    for lost in one if len(one) > 1 else ():
                        self.model.add_implication(lost, way)
                    ended.append(way.negated())
                self.model.add_bool_or([out, *ended])
        return self._outs[key]

    def _dead(self, robots: Sequence[str]) -> Any:
        return sum(self.lost[first] for first in self.groups if first in robots)

    # -- what survives ------------------------------------------------------------------------

    def hold_set(self, service: int, subset: Subset, unless: Literal = None) -> None:
        """Constrain a set of needs to find its robots, unless `unless` is true."""
        spare, able = self._room(service, subset)
        gone = self._gone(service, subset, able, is_break=False)
        if isinstance(gone, int):
            if gone > spare:  # it never finds them, whatever happens
                self.model.add_bool_or([] if unless is None else [unless])
            return
        constraint = self.model.add(gone <= spare)
        if unless is not None:
            constraint.only_enforce_if(unless.negated())

    def _hold(self, service: int, robots: Sequence[str], unless: Literal = None) -> None:
        """Add constraints necessary for a service; sufficient for one need.

        Other sets follow on demand.
        """
        count = len(self.needs[service])
        subsets: list[Subset] = [(index,) for index in range(count)]
        if count > MAX_NEEDS_IN_FULL:
            subsets.append(tuple(range(count)))
        for subset in subsets:
            self.hold_set(service, subset, unless)
        if self.services[service].exclusive:
            dead = self._dead(robots)
            if not isinstance(dead, int):
                constraint = self.model.add(dead <= len(robots) - majority(robots))
                if unless is not None:
                    constraint.only_enforce_if(unless.negated())

    def keep(self, required: Requirement, robots: Sequence[str]) -> dict[int, Literal]:
        """Constrain the model so that the mission survives.

        Returns, per service, the literal that exempts it.
        """
        formulas = required.formulas
        excuses: dict[int, Literal] = {}
        true: dict[int, Literal] = {}
        ruin = formulas.terms[required.ruin]
        must = set(ruin.parts) if not ruin.is_all and ruin.service < 0 else {required.ruin}
        for each in formulas.below(required.ruin):
            term = formulas.terms[each]
            if each in (NEVER, ALWAYS):
                continue
            holds = None if each in must | {required.ruin} else self.model.new_bool_var("")
            true[each] = holds
            if term.service >= 0:
                excuses[term.service] = holds
                self._hold(term.service, robots, unless=holds)
            elif term.is_all:
                parts = [true[part].negated() for part in term.parts if true[part] is not None]
                if len(parts) == len(term.parts):
                    self.model.add_bool_or([*parts, *([] if holds is None else [holds])])
            elif holds is not None:
                for part in term.parts:
                    if true[part] is not None:
                        self.model.add_implication(true[part], holds)
        return excuses

    # -- what breaks --------------------------------------------------------------------------

    def _break(self, service: int, robots: Sequence[str], when: Literal, least: int) -> None:
        """Constrain the service to be infeasible if `when` is true.

        That takes at least `least` faults.
        """
        needs = self.needs[service]
        reasons = []
        if len(needs) <= MAX_NEEDS_IN_FULL:
            for size in range(1, len(needs) + 1):
                for subset in combinations(range(len(needs)), size):
                    spare, able = self._room(service, subset)
                    gone = self._gone(service, subset, able, is_break=True)
                    chosen = self.model.new_bool_var("")
                    self.model.add(gone >= spare + 1).only_enforce_if(chosen)
                    reasons.append(chosen)
        else:
            reasons.append(self._break_any(needs))
        if self.services[service].exclusive:
            chosen = self.model.new_bool_var("")
            reasons.append(chosen)
            spare = len(robots) - majority(robots)
            self.model.add(self._dead(robots) >= spare + 1).only_enforce_if(chosen)
        self.model.add_bool_or([when.negated(), *reasons])
        self.model.add(self.total >= least).only_enforce_if(when)

    def _break_any(self, needs: Sequence[JointNeed]) -> Literal:
        """Return a literal: some set of many needs asks for more robots than can do any of it."""
        when = self.model.new_bool_var("")
        asked = [self.model.new_bool_var("") for _ in needs]
        able: list[Any] = []
        robots = sorted({robot for need in needs for robot in need.entries})
        if any(robot in self._group_of for robot in robots):
            robots = [robot for robot in robots if robot in self.groups]
        for robot in robots:
            losses = self.lost.get(robot)
            size = len(self.groups.get(robot, (robot,)))
            count = self.model.new_int_var(0, size, "")
            for need, is_asked in zip(needs, asked, strict=True):
                if robot not in need.entries:
                    continue
                if losses is not None:
                    self.model.add(count >= size - losses).only_enforce_if(is_asked)
                    continue
                entries = [self.lost[e] for e in need.entries[robot] if e in self.lost]
                self.model.add(count + sum(entries) >= 1).only_enforce_if(is_asked)
            able.append(count)
        counts = [need.count * is_asked for need, is_asked in zip(needs, asked, strict=True)]
        self.model.add(sum(counts) - sum(able) >= 1).only_enforce_if(when)
        return when

    def ruin(self, required: Requirement, robots: Sequence[str], least: Mapping[int, int]) -> None:
        """Constrain the model so that the mission is ruined.

        `least`: service -> its fewest faults.
        """
        formulas = required.formulas
        true: dict[int, Literal] = {}
        for each in formulas.below(required.ruin):
            term = formulas.terms[each]
            holds = true[each] = self.model.new_bool_var("")
            if term.service >= 0:
                self._break(term.service, robots, holds, least[term.service])
            elif term.is_all:
                for part in term.parts:
                    self.model.add_implication(holds, true[part])
            else:
                self.model.add_bool_or([holds.negated(), *(true[part] for part in term.parts)])
        self.model.add(true[required.ruin] == 1)


def optimum(
    model: cp_model.CpModel, variables: Mapping[Any, Any], limit_s: float
) -> tuple[Answer, dict[Any, int]]:
    """Solve the model; return the answer, and the variables' values (empty without a solution).

    One worker and a fixed seed give the same answer every time, unless the time limit is reached.
    """
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = SEED
    solver.parameters.linearization_level = 2
    solver.parameters.max_time_in_seconds = max(limit_s, 0.01)
    status = solver.solve(model)
    if status == cp_model.INFEASIBLE:
        return Answer(None, None, True), {}
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        # The solver's bound is not reliable then.
        return Answer(None, None, False), {}
    proved = status == cp_model.OPTIMAL
    # The bound is a float that may be a little below its integer.
    bound = round(solver.best_objective_bound)
    values = {key: solver.value(variable) for key, variable in variables.items()}
    return Answer(round(solver.objective_value), bound, proved), values
