"""The scheduling problem, and what a schedule comes to.

Tasks for several robots each, which have to be at a place at the same time, with precedence:
ST-MR-TA in the taxonomy of Gerkey and Mataric (2004), with the cross-schedule dependencies of
Korsah, Stentz and Dias (2013).
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias


class Objective(enum.StrEnum):
    """What is to be small: the end of the last task and way back, or the sum of the ends."""

    MAKESPAN = "makespan"
    MEAN_COMPLETION = "mean_completion"


@dataclass(frozen=True, slots=True)
class SchedulingNeed:
    """A number of robots, of those in `work_ms`: robot -> how long it works once it is there."""

    robots: int
    work_ms: Mapping[int, int]


@dataclass(frozen=True, slots=True)
class SchedulingTask:
    """One task at one place, None: wherever its robots are. `after`: the tasks that end before any
    of its robots sets out.

    Together: its robots begin when all of them are there, and end with the slowest. Otherwise each
    begins when it is there, and the task ends with the last. `ready_ms`: none sets out before.
    """

    place: int | None
    needs: tuple[SchedulingNeed, ...]
    after: tuple[int, ...] = ()
    is_together: bool = True
    ready_ms: int = 0


@dataclass(frozen=True, slots=True)
class SchedulingProblem:
    """What is to be done, and by whom. Robots, tasks and places are numbered from 0.

    `free_ms` and `at`: when each robot has ended what it does now, and at which place it is then.
    `travel_ms[robot][from][to]`; robots of one type may share a table. `home`: the place to which
    each robot returns in the end, None if it does not.
    """

    tasks: tuple[SchedulingTask, ...]
    free_ms: tuple[int, ...]
    at: tuple[int, ...]
    travel_ms: Sequence[Sequence[Sequence[int]]]
    home: tuple[int | None, ...]
    objective: Objective = Objective.MAKESPAN


# The robots for each need of a task.
Coalition: TypeAlias = tuple[tuple[int, ...], ...]


class Step(NamedTuple):
    """One task of a schedule."""

    task: int
    coalition: Coalition


# Each robot does its tasks in this order. No task comes before one that it is after.
Schedule: TypeAlias = tuple[Step, ...]


@dataclass(frozen=True, slots=True)
class Course:
    """What a schedule comes to: when the work of each step begins and ends, and the cost by the
    objective; less is better.
    """

    begins_ms: tuple[int, ...]
    ends_ms: tuple[int, ...]
    cost: int


def course_of(problem: SchedulingProblem, schedule: Schedule) -> Course:
    """Carry out a schedule: each robot sets out for its next task as soon as it can.

    Raises ValueError if it is no schedule of all tasks of this problem.
    """
    free_ms, at = list(problem.free_ms), list(problem.at)
    ended_ms: dict[int, int] = {}
    begins_ms = []
    for number, coalition in schedule:
        task = _task_of(problem, number, coalition, ended_ms)
        leaves_ms = max([task.ready_ms, *(ended_ms[each] for each in task.after)])
        arrivals_ms = {
            robot: max(free_ms[robot], leaves_ms) + _way_ms(problem, robot, at[robot], task.place)
            for robots in coalition
            for robot in robots
        }
        all_are_there_ms = max(arrivals_ms.values())
        for need, robots in zip(task.needs, coalition, strict=True):
            for robot in robots:
                begin_ms = all_are_there_ms if task.is_together else arrivals_ms[robot]
                free_ms[robot] = begin_ms + need.work_ms[robot]
                at[robot] = at[robot] if task.place is None else task.place
        ended_ms[number] = last_ms = max(free_ms[robot] for robot in arrivals_ms)
        if task.is_together:
            for robot in arrivals_ms:
                free_ms[robot] = last_ms
        begins_ms.append(all_are_there_ms if task.is_together else min(arrivals_ms.values()))
    if len(ended_ms) < len(problem.tasks):
        raise ValueError(f"a schedule of {len(ended_ms)} of {len(problem.tasks)} tasks")
    ends_ms = tuple(ended_ms.values())
    return Course(tuple(begins_ms), ends_ms, cost_of(problem, free_ms, at, ends_ms))


def cost_of(
    problem: SchedulingProblem, free_ms: Sequence[int], at: Sequence[int], ends_ms: Sequence[int]
) -> int:
    """By the objective; `free_ms` and `at` of each robot once all tasks have ended."""
    if problem.objective is Objective.MEAN_COMPLETION:
        return sum(ends_ms)
    last_ms = max(ends_ms, default=0)
    for robot, home in enumerate(problem.home):
        if home is not None:
            last_ms = max(last_ms, free_ms[robot] + problem.travel_ms[robot][at[robot]][home])
    return last_ms


def _way_ms(problem: SchedulingProblem, robot: int, origin: int, goal: int | None) -> int:
    return 0 if goal is None else problem.travel_ms[robot][origin][goal]


def _task_of(
    problem: SchedulingProblem, number: int, coalition: Coalition, ended_ms: Mapping[int, int]
) -> SchedulingTask:
    """The task of a step. Raises ValueError if the problem does not allow the step."""
    if not 0 <= number < len(problem.tasks) or number in ended_ms:
        raise ValueError(f"task {number} is unknown or occurs twice")
    task = problem.tasks[number]
    if not ended_ms.keys() >= set(task.after):
        raise ValueError(f"task {number} comes before one that it is after")
    robots = [robot for each in coalition for robot in each]
    is_served = len(coalition) == len(task.needs) and all(
        len(each) == need.robots and need.work_ms.keys() >= set(each)
        for need, each in zip(task.needs, coalition, strict=True)
    )
    if not is_served or not robots or len(set(robots)) < len(robots):
        raise ValueError(f"task {number} needs other robots")
    return task
