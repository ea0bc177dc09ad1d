"""The questions that are asked about a mission: which services, and which of them are required."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from mrbt_mesh.analysis.tolerance.bound import bound_services
from mrbt_mesh.analysis.tolerance.fault_counts import Reading
from mrbt_mesh.analysis.tolerance.requirement import (
    ALWAYS,
    Formulas,
    Requirement,
    every,
    tree_requirement,
)
from mrbt_mesh.analysis.tolerance.service import Service, service, somebody
from mrbt_mesh.analysis.tolerance.width import StuckError, widths
from mrbt_mesh.core.mission.mission import FailurePolicy, GlobalTask, Mission


@dataclass(frozen=True)
class Question:
    """A reading, and why it has no answer where the mission is not feasible at all."""

    reading: Reading
    obstacle: str = ""


def serial(mission: Mission) -> Question:
    """The tree run serially if need be: each task that is required can be served alone."""
    services, numbers, deciding = serial_services(mission)

    def waits(task: str) -> bool:
        return mission.global_tasks[task].blocked_fail_after_us is None

    required = tree_requirement(mission.tree, numbers, waits, deciding)
    if required is None:
        return Question(_impossible(mission, services), "the tree itself can never succeed")
    return _checked(Reading(mission, services, required))


def serial_services(
    mission: Mission,
) -> tuple[tuple[Service, ...], dict[str, list[int]], dict[str, list[list[int]]]]:
    """The services of a mission; global task -> those that it takes to do it; -> ways to fail."""
    services, numbers = _tasks(mission)
    deciding: dict[str, list[list[int]]] = {}
    for task in mission.global_tasks.values():
        for way in _ways_to_fail(mission, task):
            numbered = list(range(len(services), len(services) + len(way)))
            deciding.setdefault(task.id, []).append(numbered)
            services = (*services, *way)
    return (*services, somebody(mission)), numbers, deciding


def every_task(mission: Mission) -> Question:
    """No alternative is given up: every global task of the tree can be served alone."""
    services, _ = _tasks(mission)
    required = every(range(len(services)))
    return _checked(Reading(mission, (*services, somebody(mission)), required))


def parallel_width(mission: Mission) -> Question:
    """What the fault-free plan serves at one time stays feasible together."""
    try:
        stages = tuple({each.tasks: each for each in widths(mission)}.values())
    except StuckError as error:
        return Question(_impossible(mission, ()), str(error))
    tasks = dict.fromkeys(task for stage in stages for task in stage.tasks)
    for task in tasks:
        stages = (*stages, *bound_services(mission, mission.global_tasks[task]))
    required = every(range(len(stages)))
    return _checked(Reading(mission, (*stages, somebody(mission)), required))


READINGS: dict[str, Callable[[Mission], Question]] = {
    "serial": serial,
    "keeps_every_task": every_task,
    "keeps_parallel_width": parallel_width,
}


def _tasks(mission: Mission) -> tuple[tuple[Service, ...], dict[str, list[int]]]:
    """Each global task served alone; global task -> the services that it takes."""
    tasks = mission.global_tasks.values()
    services = [service(mission, (task,), task.id) for task in tasks]
    numbers = {each.name: [number] for number, each in enumerate(services)}
    for task in tasks:
        bound = bound_services(mission, task)
        numbers[task.id] += range(len(services), len(services) + len(bound))
        services += bound
    return tuple(services), {task: _all_before(mission, task, numbers) for task in numbers}


def _all_before(mission: Mission, task: str, numbers: Mapping[str, list[int]]) -> list[int]:
    """The services of a task and of those whose robots it needs."""
    seen, waiting = dict.fromkeys([task]), [task]
    for each in waiting:
        befores = [need.same_robot_as for need in mission.global_tasks[each].needs]
        new = [b.global_task for b in befores if b and b.global_task not in seen]
        seen |= dict.fromkeys(new)
        waiting += new
    return [number for each in seen for number in numbers[each]]


def _ways_to_fail(mission: Mission, task: GlobalTask) -> list[list[Service]]:
    """What it takes that a task can fail, for those that cannot always: one way is enough.

    A patient task fails at a need of which no robot is missing, or else those who may return could
    make it good; of a coalition of robots for several needs nobody at all may be missing. An
    exclusive task that has been blocked fails if a majority lives to decide it.
    """
    if task.blocked_fail_after_us is not None:
        if not task.exclusive:
            return []
        return [[Service(f"a majority for {task.id}", (task.id,), (), True)]]
    if task.failure is not FailurePolicy.PATIENT:
        return []
    found = []
    for need in service(mission, (task,), task.id).needs:
        name = f"{task.id} with all robots for {need.local_task}"
        everyone = replace(need, count=len(need.entries))
        found.append(Service(name, (task.id,), (everyone,), False))
    return [found] if task.by_coalition else [[each] for each in found]


def _impossible(mission: Mission, services: tuple[Service, ...]) -> Reading:
    return Reading(mission, services, Requirement(Formulas(), ALWAYS))


def _checked(reading: Reading) -> Question:
    last = len(reading.services) - 1  # somebody
    if not reading.required.is_ruined(range(last)):
        # Conditions may be all that it takes, and who is left to read them?
        formulas = reading.required.formulas
        ruin = formulas.any((reading.required.ruin, formulas.atom(last)))
        reading = replace(reading, required=Requirement(formulas, ruin))
    if reading.is_feasible:
        return Question(reading)
    names = ", ".join(reading.services[each].name for each in sorted(reading.at_first))
    return Question(reading, f"even without faults the robots cannot do {names}")
