"""Weak and strong fault tolerance: by definition, by the paper's lemmas, and by those corrected.

The definition: every single fault of a kind is survived. It is checked fault by fault with the
runtime's own *Check Consistency*. The corrected lemma: problem (2) stays consistent with the faulty
robot or capability removed; it is put to a solver, as a flow. The literal
lemmas (paper, section V-B) ask instead for a consistent assignment *of the whole team* in which no
stand-in works on the same local task; they say yes where the stand-in is needed elsewhere, and
no where a capability that nothing needs is unique.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ortools.graph.python.max_flow import SimpleMaxFlow
from ortools.sat.python import cp_model

from mrbt_mesh.analysis.tolerance.fault_counts import Reading
from mrbt_mesh.analysis.tolerance.model import SEED, Literal
from mrbt_mesh.analysis.tolerance.service import Capability, Fault, FaultyTeam, JointNeed, Service

LEMMA_LIMIT_S = 10.0


@dataclass(frozen=True)
class Difference:
    """A fault that the literal lemma judges otherwise than the definition, and why."""

    fault: Fault
    literal: bool
    definition: bool
    reason: str


@dataclass(frozen=True)
class Verdicts:
    """One kind of fault tolerance, found in three ways; `literal` is None if time ran out."""

    definition: bool
    corrected: bool
    literal: bool | None
    differences: tuple[Difference, ...]


def verdicts(
    reading: Reading,
    faults: Sequence[Fault],
    critical: Iterable[Fault],
) -> Verdicts:
    """`critical`: the fatal ones among `faults`, found exhaustively, which is the definition."""
    fatal = set(critical)
    holds = _Literal(reading, fatal)
    corrected = _Corrected(reading)
    stays_consistent = reading.is_feasible
    differences = []
    literal: bool | None = True
    for fault in faults:
        survived = reading.is_feasible and fault not in fatal
        stays_consistent = stays_consistent and corrected.holds(fault)
        says, why = holds.judge(fault)
        if says is None:
            literal = None if literal else literal
        elif says != survived:
            differences.append(Difference(fault, says, survived, why))
        if says is False:
            literal = False
    definition = reading.is_feasible and not fatal
    return Verdicts(definition, stays_consistent, literal, tuple(differences))


class _Corrected:
    """The corrected lemma: problem (2) is consistent with a robot or capability removed."""

    def __init__(self, reading: Reading) -> None:
        self.reading = reading
        self.at_first = self._inconsistent(FaultyTeam(reading.mission), reading.required.services)

    def _inconsistent(self, team: FaultyTeam, services: Iterable[int]) -> set[int]:
        services = list(services)
        return {each for each in services if not _is_consistent(team, self.reading.services[each])}

    def holds(self, fault: Fault) -> bool:
        """Whether it holds for one fault; what the fault does not touch stays as it was."""
        reading = self.reading
        touched = {each for each in reading.required.services if reading.may_change(each, fault)}
        now = self._inconsistent(FaultyTeam(reading.mission).with_faults(fault), touched)
        return not reading.required.is_ruined(now | (self.at_first - touched))


def _is_consistent(team: FaultyTeam, wanted: Service) -> bool:
    """Whether problem (2) has a solution: as many robots flow to the needs as they ask for.

    Robots that can meet the same needs are one source.
    """
    if wanted.exclusive and not team.has_majority():
        return False
    able = [team.able(need) for need in wanted.needs]
    alike: dict[tuple[int, ...], int] = {}
    for robot in {robot for row in able for robot in row}:
        key = tuple(index for index, row in enumerate(able) if robot in row)
        alike[key] = alike.get(key, 0) + 1
    flow = SimpleMaxFlow()
    first = len(wanted.needs)
    source, sink = first + len(alike), first + len(alike) + 1
    for number, (indices, count) in enumerate(sorted(alike.items())):
        flow.add_arc_with_capacity(source, first + number, count)
        for index in indices:
            flow.add_arc_with_capacity(first + number, index, count)
    for index, need in enumerate(wanted.needs):
        flow.add_arc_with_capacity(index, sink, need.count)
    if flow.solve(source, sink) != flow.OPTIMAL:
        return False
    return bool(flow.optimal_flow() == sum(need.count for need in wanted.needs))


class _Literal:
    """The lemmas as printed, for one fault at a time."""

    def __init__(self, reading: Reading, fatal: set[Fault]) -> None:
        self.reading = reading
        self.fatal = fatal
        self.team = FaultyTeam(reading.mission)
        self.holders: dict[str, list[str]] = {}
        for robot in sorted(reading.mission.robots):
            for name in reading.mission.robots[robot].capabilities:
                self.holders.setdefault(name, []).append(robot)

    def judge(self, fault: Fault) -> tuple[bool | None, str]:
        """Whether the lemma's condition holds for this robot or capability (None: not found out
        in time), and what explains it if the definition differs.
        """
        names = self.reading.mission.robots[fault].capabilities if isinstance(fault, str) else ()
        robot, name = (fault, "") if isinstance(fault, str) else fault
        unique = [each for each in names or ([name] if name else []) if self._is_unique(each)]
        if unique:
            return False, f"nobody else has {', '.join(unique)}, which no task depends on"
        if not self.reading.is_feasible:
            return False, "the mission is not feasible even without faults"
        if fault not in self.fatal:
            # Without the faulty robot there is a consistent assignment, so with it idle too.
            return True, ""
        holds = self._major(robot) if isinstance(fault, str) else self._minor(fault)
        return holds, self._why(fault)

    def _is_unique(self, name: str) -> bool:
        return len(self.holders[name]) == 1

    def _why(self, fault: Fault) -> str:
        broken = self.reading.broken_by(fault)
        worst = [
            self.reading.services[each]
            for each in sorted(broken)
            if self.reading.required.is_ruined({each})
        ] or [self.reading.services[each] for each in sorted(broken)]
        what = worst[0].name
        if worst[0].exclusive and not self.team.with_faults(fault).has_majority():
            return f"{what} is exclusive, and too few robots are left to grant it"
        return f"its stand-ins have other work in {what} at that time"

    def _minor(self, fault: Capability) -> bool:
        """Some other robot h with the capability, and (2) consistent with r(i,j) r(h,j) = 0."""
        robot, name = fault
        services = self.reading.required.services
        at_first = self.reading.infeasible(self.team)
        for other in self.holders[name]:
            if other == robot:
                continue
            touched = [e for e in services if fault in self.reading.services[e].touched_by]
            infeasible = {
                each
                for each in touched
                if not self._is_feasible_apart(self.reading.services[each], fault, other)
            }
            if not self.reading.required.is_ruined(infeasible | at_first):
                return True
        return False

    def _is_feasible_apart(self, wanted: Service, fault: Capability, other: str) -> bool:
        """The service with the robot and the other one never on the same such local task."""
        if not self.team.is_feasible(wanted):
            return False
        robot, _ = fault
        shared = [
            number
            for number, need in enumerate(wanted.needs)
            if fault in need.entries.get(robot, ()) and other in need.entries
        ]
        if not shared:
            return True
        for place in (None, *shared):
            needs = []
            for number, need in enumerate(wanted.needs):
                barred = {robot} if number in shared and number != place else set()
                if number == place:
                    barred = {other}
                entries = {r: e for r, e in need.entries.items() if r not in barred}
                needs.append(JointNeed(need.local_task, need.count, entries))
            if self.team.can_meet(needs):
                return True
        return False

    def _major(self, robot: str) -> bool | None:
        """Some set I of others that covers the robot's capabilities, and (2) consistent with
        none of them on a local task that the robot is on.

        A model of its own: who is in I, and an assignment for each service.
        """
        reading = self.reading
        model = cp_model.CpModel()
        others = [each for each in self.team.alive if each != robot]
        stands_in = {other: model.new_bool_var(other) for other in others}
        for name in reading.mission.robots[robot].capabilities:
            model.add_bool_or([stands_in[h] for h in self.holders[name] if h != robot])
        feasible = {}
        broken = reading.broken_by(robot)
        for each in reading.required.services:
            wanted = reading.services[each]
            feasible[each] = model.new_bool_var(wanted.name)
            if not self.team.is_feasible(wanted):
                model.add(feasible[each] == 0)
            elif each in broken:
                self._assign(model, wanted, feasible[each], robot, stands_in)
        formulas = reading.required.formulas
        true: dict[int, Literal] = {}
        for each in formulas.below(reading.required.ruin):
            term = formulas.terms[each]
            holds = true[each] = model.new_bool_var("")
            if term.service >= 0:
                model.add_bool_or([holds, feasible[term.service]])
            elif term.is_all:
                model.add_bool_or([holds, *(true[part].negated() for part in term.parts)])
            else:
                for part in term.parts:
                    model.add_implication(true[part], holds)
        model.add(true[reading.required.ruin] == 0)
        solver = cp_model.CpSolver()
        solver.parameters.num_workers = 1
        solver.parameters.random_seed = SEED
        solver.parameters.max_time_in_seconds = LEMMA_LIMIT_S
        status = solver.solve(model)
        if status == cp_model.UNKNOWN:
            return None
        return status in (cp_model.OPTIMAL, cp_model.FEASIBLE)

    def _assign(
        self,
        model: cp_model.CpModel,
        wanted: Service,
        when: Literal,
        robot: str,
        stands_in: dict[str, Literal],
    ) -> None:
        rows: dict[str, list[Literal]] = {}
        for need in wanted.needs:
            works = {each: model.new_bool_var("") for each in sorted(need.entries)}
            for each, literal in works.items():
                rows.setdefault(each, []).append(literal)
                if robot in works and each != robot:
                    model.add_bool_or(
                        [literal.negated(), works[robot].negated(), stands_in[each].negated()]
                    )
            model.add(sum(works.values()) >= need.count).only_enforce_if(when)
        for row in rows.values():
            model.add_at_most_one(row)
