"""The cheapest extra robots or capabilities that make a team weakly or strongly fault tolerant.

The model has the additions as variables, and requires that the mission survives without faults and
after each of a list of single faults. Any single fault that is fatal to the enlarged team is added
to the list and the model is solved again, until there is none. So the last answer is the cheapest.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from ortools.sat.python import cp_model

from mrbt_mesh.analysis.tolerance.fault_counts import Reading
from mrbt_mesh.analysis.tolerance.model import SEED
from mrbt_mesh.analysis.tolerance.readings import serial_services
from mrbt_mesh.analysis.tolerance.requirement import ALWAYS
from mrbt_mesh.analysis.tolerance.service import (
    ANYBODY,
    Capability,
    Fault,
    JointNeed,
    Service,
    capability_faults,
    robot_faults,
)
from mrbt_mesh.core.mission.mission import MICRO, Costs, Mission, Robot
from mrbt_mesh.core.mission.names import type_name

MAX_EXTRA_ROBOTS = 20
_NEW = "+"  # no robot of a mission file may be called that
Variable: TypeAlias = Any  # ortools' variables and expressions
# ("robot", id); for new ones ("type", robot type), and ("hit", robot type) for one with a fault.
_Source: TypeAlias = tuple[str, str]


@dataclass(frozen=True)
class Additions:
    """What to add: numbers of robots by type, and capabilities of existing robots.

    `cost` is None if nothing helps, or nothing was found in time. `bound`: nothing cheaper helps.
    """

    cost: int | None
    bound: int | None
    is_proved: bool
    robots: Mapping[str, int]
    capabilities: tuple[Capability, ...]


def enlarged(mission: Mission, robots: Mapping[str, int], extra: Iterable[Capability]) -> Mission:
    """Return the mission with more robots, named +TYPE-1 and so on, and more capabilities."""
    team = dict(mission.robots)
    for robot, name in extra:
        able = dict(team[robot].capabilities) | {name: MICRO}
        team[robot] = replace(team[robot], capabilities=able)
    for kind, count in robots.items():
        for number in range(1, count + 1):
            robot = f"{_NEW}{kind}-{number}"
            team[robot] = Robot(robot, kind, mission.robot_types[kind])
    return replace(mission, robots=dict(sorted(team.items())))


def re_read(reading: Reading, mission: Mission) -> Reading:
    """Return the serial reading's question about the same mission with another team."""
    services, _, _ = serial_services(mission)
    return Reading(mission, services, reading.required)


def advise(
    reading: Reading,
    is_strong: bool,
    costs: Costs,
    limit_s: float,
    kinds: tuple[bool, bool] = (True, True),
) -> Additions:
    """Return the cheapest additions.

    `kinds`: whether robots, and whether capabilities, may be added.
    """
    deadline_s = time.monotonic() + limit_s
    single = robot_faults(reading.mission) if is_strong else capability_faults(reading.mission)
    if reading.is_feasible and not reading.critical(single):
        return Additions(0, 0, True, {}, ())
    if any(reading.services[each].is_bound for each in reading.required.services):
        # An added robot would have to do both tasks, and not be lost after either.
        return Additions(None, 0, False, {}, ())
    built = _Advice(reading, costs, *kinds)
    built.survive(None)
    bound = 0
    while True:
        solved = built.solve(deadline_s - time.monotonic())
        if solved is None:
            return Additions(None, None, True, {}, ())
        answer, bound = solved, max(bound, solved.bound or 0)
        if answer.cost is None:
            return replace(answer, bound=bound)
        team = enlarged(reading.mission, answer.robots, answer.capabilities)
        faults = robot_faults(team) if is_strong else capability_faults(team)
        critical = re_read(reading, team).critical(faults)
        if not critical:
            return replace(answer, bound=bound, is_proved=answer.is_proved)
        if time.monotonic() > deadline_s:
            return Additions(None, bound, False, {}, ())
        for fault in {_canonical(reading.mission, fault): fault for fault in critical}:
            built.survive(fault)


def _canonical(mission: Mission, fault: Fault) -> Fault:
    """Return a fault that stands for those alike: of the new robots of a type, the first."""
    robot = _robot_of(fault)
    if robot in mission.robots:
        return fault
    first = f"{robot.rpartition('-')[0]}-1"
    return first if isinstance(fault, str) else (first, fault[1])


class _Advice:
    def __init__(
        self, reading: Reading, costs: Costs, with_robots: bool, with_capabilities: bool
    ) -> None:
        self.reading = reading
        self.mission = reading.mission
        self.model = cp_model.CpModel()
        used = [reading.services[each] for each in reading.required.services]
        tasks = sorted({need.local_task for each in used for need in each.needs})
        names = sorted({type_name(task) for task in tasks if task != ANYBODY})
        self.robots: dict[str, Variable] = {}
        self.extra: dict[Capability, Variable] = {}
        if with_robots:
            for kind, able in sorted(self.mission.robot_types.items()):
                if ANYBODY in tasks or any({task, type_name(task)} & able.keys() for task in tasks):
                    self.robots[kind] = self.model.new_int_var(0, MAX_EXTRA_ROBOTS, kind)
        if with_capabilities:
            for robot in self.mission.robots.values():
                for name in names:
                    if name not in robot.capabilities:
                        self.extra[robot.id, name] = self.model.new_bool_var("")
        self.any_new = {kind: self.model.new_bool_var("") for kind in self.robots}
        for kind, count in self.robots.items():
            self.model.add(count >= 1).only_enforce_if(self.any_new[kind])
            self.model.add(count == 0).only_enforce_if(self.any_new[kind].negated())
        prices = [costs.robot(kind) * count for kind, count in self.robots.items()]
        prices += [costs.capability(name) * added for (_, name), added in self.extra.items()]
        self.cost = sum(prices)
        # Among equally cheap additions, prefer the fewest parts.
        self.parts = sum(self.robots.values()) + sum(self.extra.values())
        self.weight = MAX_EXTRA_ROBOTS * max(1, len(self.robots)) + len(self.extra) + 1
        self.model.minimize(self.cost * self.weight + self.parts)
        self.settled: dict[int, Variable] = {}

    def solve(self, limit_s: float) -> Additions | None:
        """Return the cheapest additions for the faults so far; None if nothing helps."""
        solver = cp_model.CpSolver()
        solver.parameters.num_workers = 1
        solver.parameters.random_seed = SEED
        solver.parameters.max_time_in_seconds = max(0.01, limit_s)
        status = solver.solve(self.model)
        if status == cp_model.INFEASIBLE:
            return None
        if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            return Additions(None, None, False, {}, ())
        bound = max(0, round(solver.best_objective_bound)) // self.weight
        robots = {kind: n for kind, count in self.robots.items() if (n := solver.value(count))}
        extra = tuple(key for key, added in self.extra.items() if solver.value(added))
        cost = round(solver.objective_value) // self.weight
        return Additions(cost, bound, status == cp_model.OPTIMAL, robots, extra)

    def survive(self, fault: Fault | None) -> None:
        """Require that the mission is not ruined after this fault; None: without faults."""
        required = self.reading.required
        formulas = required.formulas
        true: dict[int, Variable] = {}
        for each in formulas.below(required.ruin):
            term = formulas.terms[each]
            if each == ALWAYS:
                self.model.add_bool_or([])
                return
            holds = true[each] = self.model.new_bool_var("")
            if term.service >= 0:
                feasible = self._feasible(term.service, fault)
                self.model.add_bool_or([holds, feasible])
            elif term.is_all:
                self.model.add_bool_or([holds, *(true[part].negated() for part in term.parts)])
            else:
                for part in term.parts:
                    self.model.add_implication(true[part], holds)
        self.model.add(true[required.ruin] == 0)

    def _feasible(self, number: int, fault: Fault | None) -> Variable:
        """Return a literal that may be true only if the service is feasible after the fault."""
        wanted = self.reading.services[number]
        if fault is not None and not self._may_change(wanted, fault) and number in self.settled:
            return self.settled[number]
        feasible = self.model.new_bool_var("")
        if fault is None:
            self.settled[number] = feasible
        self._flow(wanted, fault, feasible)
        if wanted.exclusive and isinstance(fault, str):
            # After one death, n robots keep a majority only if n is at least three.
            total = len(self.mission.robots) + sum(self.robots.values())
            self.model.add(total >= 3).only_enforce_if(feasible)
        return feasible

    def _may_change(self, wanted: Service, fault: Fault) -> bool:
        if isinstance(fault, str):
            return True
        return any(type_name(need.local_task) == type_name(fault[1]) for need in wanted.needs)

    def _flow(self, wanted: Service, fault: Fault | None, when: Variable) -> None:
        """Require enough robots for every need if `when` is true, none of them twice."""
        rows: dict[_Source, list[Variable]] = {}
        for need in wanted.needs:
            posts = []
            for source, most in (*self._present(need, fault), *self._added(need, fault)):
                post = self.model.new_int_var(0, MAX_EXTRA_ROBOTS, "")
                self.model.add(post <= most)
                rows.setdefault(source, []).append(post)
                posts.append(post)
            self.model.add(sum(posts) >= need.count).only_enforce_if(when)
        for (kind, name), row in rows.items():
            supply: Variable = 1
            if kind == "type":
                # The robot that the fault hits is counted apart from the others of its type.
                is_hit = fault is not None and _robot_of(fault) == _first_of(name)
                supply = self.robots[name] - (self.any_new[name] if is_hit else 0)
            elif kind == "hit":
                supply = self.any_new[name]
            self.model.add(sum(row) <= supply)

    def _present(self, need: JointNeed, fault: Fault | None) -> Iterator[tuple[_Source, Variable]]:
        """Yield existing robots that can meet a need, or could with an addition."""
        name = type_name(need.local_task)
        for robot in sorted(self.mission.robots):
            added = self.extra.get((robot, name))
            if fault == (robot, name) and added is not None and robot in need.entries:
                # The fault removes the addition; without an addition, the robot stays able.
                yield ("robot", robot), 1 - added
            elif fault in (robot, (robot, name), (robot, need.local_task)):
                continue
            elif robot in need.entries:
                yield ("robot", robot), 1
            elif added is not None:
                yield ("robot", robot), added

    def _added(self, need: JointNeed, fault: Fault | None) -> Iterator[tuple[_Source, Variable]]:
        """Yield new robots that can meet a need."""
        names = (need.local_task, type_name(need.local_task))
        for kind in self.robots:
            able = {*self.mission.robot_types[kind], ANYBODY}
            if able.isdisjoint(names):
                continue
            yield ("type", kind), MAX_EXTRA_ROBOTS
            first = _first_of(kind)
            if isinstance(fault, tuple) and fault[0] == first and fault[1] not in names:
                yield ("hit", kind), 1


def _first_of(kind: str) -> str:
    return f"{_NEW}{kind}-1"


def _robot_of(fault: Fault) -> str:
    return fault if isinstance(fault, str) else fault[0]
