"""The scheduling problem, and what a schedule comes to.

Tasks for several robots each, which have to be at a place at the same time, with precedence:
ST-MR-TA in the taxonomy of Gerkey and Mataric (2004), with the cross-schedule dependencies of
Korsah, Stentz and Dias (2013).
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, TypeAlias

# A schedule replaces another one for a gain of at least one part in this many of the objective. So
# do, by the second one, schedules by rules alone, and those for which robots turn round on their
# way to tasks that have an order: what a robot has come so far is not among the facts.
MARGIN, WIDE_MARGIN = 100, 20


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

    Together: its robots begin when all of them are there. Otherwise each begins when it is there.
    Each is free when it has done its part, and the task ends with the last. `ready_ms`: none sets
    out before.

    `level`: tasks of smaller ones have priority. `arrival`: of one level, those with larger ones
    are later. `spare`: how many later tasks of its level may still overtake it; None: any number.
    `is_asked`: its robots may set out now. `deadline_ms`: when it should have ended.
    """

    place: int | None
    needs: tuple[SchedulingNeed, ...]
    after: tuple[int, ...] = ()
    is_together: bool = True
    ready_ms: int = 0
    level: int = 0
    arrival: int = 0
    spare: int | None = None
    is_asked: bool = True
    deadline_ms: int | None = None

    @property
    def robots(self) -> int:
        """How many robots it lacks."""
        return sum(need.robots for need in self.needs)

    def is_before(self, other: SchedulingTask) -> bool:
        """Whether the other one overtakes this one if it begins first."""
        return (self.level, self.arrival) < (other.level, other.arrival)


@dataclass(frozen=True)
class SchedulingProblem:
    """What is to be done, and by whom. Robots, tasks and places are numbered from 0.

    `free_ms` and `at`: when each robot has ended what it does now, and at which place it is then.
    `travel_ms[robot][from][to]`; robots of one type may share a table. `home`: the place to which
    each robot returns in the end, None if it does not. `at_work`: robots that begin nothing now.
    `under_way`: robot -> the task to which it has set out; of these `fixed` are those that turn
    round for priority alone.
    """

    tasks: tuple[SchedulingTask, ...]
    free_ms: tuple[int, ...]
    at: tuple[int, ...]
    travel_ms: Sequence[Sequence[Sequence[int]]]
    home: tuple[int | None, ...]
    objective: Objective = Objective.MAKESPAN
    at_work: frozenset[int] = frozenset()
    under_way: Mapping[int, int] = field(default_factory=dict)
    fixed: frozenset[int] = frozenset()

    @cached_property
    def in_order(self) -> tuple[int, ...]:
        """All tasks, those with priority first, then as they arrived."""
        tasks = self.tasks
        key = ((task.level, task.arrival, number) for number, task in enumerate(tasks))
        return tuple(number for _, _, number in sorted(key))

    @cached_property
    def has_order(self) -> bool:
        """Whether some task overtakes another one if it begins first."""
        return len({(task.level, task.arrival) for task in self.tasks}) > 1

    @cached_property
    def has_deadlines(self) -> bool:
        """Whether some task should have ended by a time."""
        return any(task.deadline_ms is not None for task in self.tasks)


# The robots for each need of a task.
Crew: TypeAlias = tuple[tuple[int, ...], ...]


class Step(NamedTuple):
    """One task of a schedule."""

    task: int
    crew: Crew


# Each robot does its tasks in this order. No task comes before one that it is after.
Schedule: TypeAlias = tuple[Step, ...]


class Rank(NamedTuple):
    """By which of two schedules is better; less is better.

    `missed`: how many deadlines are missed, those of tasks with priority first. `cost`: by the
    objective, with a surcharge if robots turn round. `other`: by the other objective.
    """

    missed: tuple[int, ...]
    cost: int
    other: int

    def is_clearly_better(self, than: Rank, margin: int | None = None) -> bool:
        """Whether it is worth while to change over; `margin`: other than `MARGIN`."""
        parts = margin or MARGIN
        if self.missed != than.missed:
            return self.missed < than.missed
        if self.cost * parts <= than.cost * (parts - 1):
            return self.cost < than.cost
        return self.cost <= than.cost and self.other * parts < than.other * (parts - 1)


class Value(NamedTuple):
    """What a schedule comes to: its cost by the objective, and its rank."""

    cost: int
    rank: Rank


@dataclass(frozen=True, slots=True)
class Course:
    """What a schedule comes to: when the work of each step begins and ends, the cost by the
    objective, and its rank; less is better.
    """

    begins_ms: tuple[int, ...]
    ends_ms: tuple[int, ...]
    cost: int
    rank: Rank


def course_of(problem: SchedulingProblem, schedule: Schedule) -> Course:
    """Carry out a schedule: each robot sets out for its next task as soon as it can.

    Raises ValueError if it is no schedule of all tasks of this problem.
    """
    free_ms, at = list(problem.free_ms), list(problem.at)
    ended_ms: dict[int, int] = {}
    begins_ms = []
    for number, crew in schedule:
        task = _task_of(problem, number, crew, ended_ms)
        leaves_ms = max([task.ready_ms, *(ended_ms[each] for each in task.after)])
        arrivals_ms = {
            robot: max(free_ms[robot], leaves_ms) + _way_ms(problem, robot, at[robot], task.place)
            for robots in crew
            for robot in robots
        }
        all_are_there_ms = max(arrivals_ms.values())
        for need, robots in zip(task.needs, crew, strict=True):
            for robot in robots:
                begin_ms = all_are_there_ms if task.is_together else arrivals_ms[robot]
                free_ms[robot] = begin_ms + need.work_ms[robot]
                at[robot] = at[robot] if task.place is None else task.place
        ended_ms[number] = max(free_ms[robot] for robot in arrivals_ms)
        begins_ms.append(all_are_there_ms if task.is_together else min(arrivals_ms.values()))
    if len(ended_ms) < len(problem.tasks):
        raise ValueError(f"a schedule of {len(ended_ms)} of {len(problem.tasks)} tasks")
    value = value_of(problem, schedule, free_ms, at, ended_ms)
    return Course(tuple(begins_ms), tuple(ended_ms.values()), *value)


def value_of(
    problem: SchedulingProblem,
    schedule: Sequence[Step],
    free_ms: Sequence[int],
    at: Sequence[int],
    ended_ms: Mapping[int, int],
) -> Value:
    """Of a schedule; `free_ms` and `at` of each robot once all tasks have ended."""
    ends_ms = ended_ms.values()
    total_ms, last_ms = sum(ends_ms), max(ends_ms, default=0)
    for robot, home in enumerate(problem.home):
        if home is not None:
            last_ms = max(last_ms, free_ms[robot] + problem.travel_ms[robot][at[robot]][home])
    cost, other = last_ms, total_ms
    if problem.objective is Objective.MEAN_COMPLETION:
        cost, other = other, cost
    missed = _missed(problem, ended_ms) if problem.has_deadlines else ()
    surcharge = 0
    if problem.under_way and problem.has_order and turning(problem, schedule):
        surcharge = cost // WIDE_MARGIN
    return Value(cost, Rank(missed, cost + surcharge, other))


def turning(problem: SchedulingProblem, schedule: Sequence[Step]) -> set[int]:
    """The robots that turn round on their way, but for a task with priority."""
    left, found, tasks = dict(problem.under_way), set[int](), problem.tasks
    for number, crew in schedule:
        if not left:
            break
        for robots in crew:
            for robot in robots:
                goal = left.pop(robot, number)
                if goal != number and tasks[number].level >= tasks[goal].level:
                    found.add(robot)
    return found | left.keys()


def _missed(problem: SchedulingProblem, ended_ms: Mapping[int, int]) -> tuple[int, ...]:
    """How many deadlines are missed, level by level."""
    found: dict[int, int] = {}
    for number, task in enumerate(problem.tasks):
        if task.deadline_ms is not None:
            is_late = ended_ms[number] > task.deadline_ms
            found[task.level] = found.get(task.level, 0) + is_late
    return tuple(found[level] for level in sorted(found))


def _way_ms(problem: SchedulingProblem, robot: int, origin: int, goal: int | None) -> int:
    return 0 if goal is None else problem.travel_ms[robot][origin][goal]


def _task_of(
    problem: SchedulingProblem, number: int, crew: Crew, ended_ms: Mapping[int, int]
) -> SchedulingTask:
    """The task of a step. Raises ValueError if the problem does not allow the step."""
    if not 0 <= number < len(problem.tasks) or number in ended_ms:
        raise ValueError(f"task {number} is unknown or occurs twice")
    task = problem.tasks[number]
    if not ended_ms.keys() >= set(task.after):
        raise ValueError(f"task {number} comes before one that it is after")
    robots = [robot for each in crew for robot in each]
    is_served = len(crew) == len(task.needs) and all(
        len(each) == need.robots and need.work_ms.keys() >= set(each)
        for need, each in zip(task.needs, crew, strict=True)
    )
    if not is_served or not robots or len(set(robots)) < len(robots):
        raise ValueError(f"task {number} needs other robots")
    return task
