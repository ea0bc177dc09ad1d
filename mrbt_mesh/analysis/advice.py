"""The cheapest extra robots or capabilities that make a team weakly or strongly fault tolerant.

A model of what is added, in which the mission must survive without faults and after each of a
list of single faults. The list grows: whatever single fault is fatal to the enlarged team is
added to it and the model is solved again, until none is. So the last answer is the cheapest one.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from ortools.sat.python import cp_model

from mrbt_mesh.analysis.model import SEED
from mrbt_mesh.analysis.requirement import ALWAYS
from mrbt_mesh.analysis.service import (
    Capability,
    Fault,
    Service,
    capability_faults,
    robot_faults,
    service,
)
from mrbt_mesh.analysis.tolerance import Progress, Reading, no_progress
from mrbt_mesh.core.mission import MICRO, Costs, Mission, Robot, type_name

MAX_EXTRA_ROBOTS = 20
_NEW = "+"  # no robot of a mission file may be called that
Variable: TypeAlias = Any  # ortools' variables and expressions


@dataclass(frozen=True)
class Additions:
    """What to add: numbers of robots by type, and capabilities of robots that are there.

    `cost` is None if nothing helps, or nothing was found in time. `bound`: nothing cheaper does.
    """

    cost: int | None
    bound: int | None
    is_proved: bool
    robots: Mapping[str, int]
    capabilities: tuple[Capability, ...]


def enlarged(mission: Mission, robots: Mapping[str, int], extra: Iterable[Capability]) -> Mission:
    """The mission with more robots, named +TYPE-1 and so on, and more capabilities."""
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
    """The same question about the same mission with another team."""
    services = []
    for each in reading.services:
        tasks = tuple(mission.global_tasks[task] for task in each.tasks)
        services.append(service(mission, tasks, each.name))
    return Reading(mission, tuple(services), reading.required)


def advise(
    reading: Reading,
    is_strong: bool,
    costs: Costs,
    limit_s: float,
    kinds: tuple[bool, bool] = (True, True),
    progress: Progress = no_progress,
) -> Additions:
    """The cheapest additions; `kinds`: whether robots, and whether capabilities, may be added."""
    deadline_s = time.monotonic() + limit_s
    built = _Advice(reading, costs, *kinds)
    built.survive(None)
    bound = 0
    rounds = 0
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
        rounds += 1
        progress(rounds, rounds + 1)


def _canonical(mission: Mission, fault: Fault) -> Fault:
    """New robots of one type are alike: the first stands for all."""
    robot = fault if isinstance(fault, str) else fault[0]
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
        names = sorted({type_name(task) for task in tasks})
        self.robots: dict[str, Variable] = {}
        self.extra: dict[Capability, Variable] = {}
        if with_robots:
            for kind, able in sorted(self.mission.robot_types.items()):
                if any(task in able or type_name(task) in able for task in tasks):
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
        # Among equally cheap ones that with the fewest parts.
        self.parts = sum(self.robots.values()) + sum(self.extra.values())
        self.weight = MAX_EXTRA_ROBOTS * max(1, len(self.robots)) + len(self.extra) + 1
        self.model.minimize(self.cost * self.weight + self.parts)
        self.settled: dict[int, Variable] = {}

    def solve(self, limit_s: float) -> Additions | None:
        """The cheapest additions for the faults so far; None if nothing helps."""
        solver = cp_model.CpSolver()
        solver.parameters.num_workers = 1
        solver.parameters.random_seed = SEED
        solver.parameters.max_time_in_seconds = max(0.01, limit_s)
        status = solver.solve(self.model)
        if status == cp_model.INFEASIBLE:
            return None
        bound = max(0, int(solver.best_objective_bound + 0.5)) // self.weight
        if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            return Additions(None, bound, False, {}, ())
        robots = {kind: n for kind, count in self.robots.items() if (n := solver.value(count))}
        extra = tuple(key for key, added in self.extra.items() if solver.value(added))
        cost = round(solver.objective_value) // self.weight
        return Additions(cost, bound, status == cp_model.OPTIMAL, robots, extra)

    def survive(self, fault: Fault | None) -> None:
        """The mission must not be ruined after this fault, None: without faults."""
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
        """A literal that may be true only if the service is feasible after the fault."""
        wanted = self.reading.services[number]
        if fault is not None and not self._may_change(wanted, fault) and number in self.settled:
            return self.settled[number]
        feasible = self.model.new_bool_var("")
        if fault is None:
            self.settled[number] = feasible
        self._flow(wanted, fault, feasible)
        if wanted.exclusive and isinstance(fault, str):
            # One dead of n leaves a majority of n from three on.
            total = len(self.mission.robots) + sum(self.robots.values())
            self.model.add(total >= 3).only_enforce_if(feasible)
        return feasible

    def _may_change(self, wanted: Service, fault: Fault) -> bool:
        if isinstance(fault, str):
            return True
        return any(type_name(need.local_task) == type_name(fault[1]) for need in wanted.needs)

    def _flow(self, wanted: Service, fault: Fault | None, when: Variable) -> None:
        rows: dict[str, list[Variable]] = {}
        supply: dict[str, Variable] = {}
        seats: list[list[Variable]] = [[] for _ in wanted.needs]

        def seat(source: str, index: int, size: int, allowed: Variable = None) -> None:
            post = self.model.new_int_var(0, size, "")
            if allowed is not None:
                self.model.add(post <= allowed)
            rows.setdefault(source, []).append(post)
            seats[index].append(post)

        for index, need in enumerate(wanted.needs):
            name = type_name(need.local_task)
            for robot in sorted(self.mission.robots):
                supply[robot] = 1
                if fault in (robot, (robot, name), (robot, need.local_task)):
                    if (robot, name) in self.extra and fault == (robot, name):
                        # The loss of what was added here; before that it may be able as it was.
                        if robot in need.entries:
                            seat(robot, index, 1, 1 - self.extra[fault])
                    continue
                if robot in need.entries:
                    seat(robot, index, 1)
                elif (robot, name) in self.extra:
                    seat(robot, index, 1, self.extra[robot, name])
            for kind, count in self.robots.items():
                able = self.mission.robot_types[kind]
                if name not in able and need.local_task not in able:
                    continue
                first = f"{_NEW}{kind}-1"
                hit = {first, (first, name), (first, need.local_task)}
                supply[kind] = count
                if isinstance(fault, str) and fault == first:
                    supply[kind] = count - self.any_new[kind]
                elif fault is not None and not isinstance(fault, str) and fault[0] == first:
                    # The robot with the minor fault on its own, the others of its type beside it.
                    supply[kind], supply[first] = count - self.any_new[kind], self.any_new[kind]
                    if fault not in hit:
                        seat(first, index, 1)
                seat(kind, index, MAX_EXTRA_ROBOTS)
        for source, row in rows.items():
            self.model.add(sum(row) <= supply[source])
        for need, row in zip(wanted.needs, seats, strict=True):
            self.model.add(sum(row) >= need.count).only_enforce_if(when)
