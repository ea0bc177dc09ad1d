"""What schedules come to, by examples that can be followed by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.scheduling.problem import (
    Course,
    Objective,
    Rank,
    Schedule,
    SchedulingNeed,
    SchedulingProblem,
    SchedulingTask,
    Step,
    course_of,
)

# Three places on a line, a second apart; robot 0 starts at the first one, robot 1 at the last one.
WAYS_MS = [[0, 1_000, 2_000], [1_000, 0, 1_000], [2_000, 1_000, 0]]
BOTH = {0: 500, 1: 700}
PROBLEM = SchedulingProblem(
    tasks=(
        SchedulingTask(1, (SchedulingNeed(1, {0: 500}), SchedulingNeed(1, {1: 700}))),
        SchedulingTask(0, (SchedulingNeed(1, BOTH),)),
        SchedulingTask(2, (SchedulingNeed(2, BOTH),), after=(0,)),
    ),
    free_ms=(0, 100),
    at=(0, 2),
    travel_ms=(WAYS_MS, WAYS_MS),
    home=(0, 2),
)
SCHEDULE: Schedule = (Step(0, ((0,), (1,))), Step(1, ((0,),)), Step(2, ((0, 1),)))


def test_robots_of_a_task_wait_for_one_another_and_go_on_when_they_have_done_their_parts() -> None:
    # Task 0: robot 1 is there at 1.1 s, and works until 1.8 s; robot 0 goes on at 1.6 s, is at
    # place 0 at 2.6 s, works until 3.1 s, and is at place 2 at 5.1 s. Both begin there: robot 0
    # ends at 5.6 s and is home at 7.6 s, robot 1 ends at 5.8 s.
    assert course_of(PROBLEM, SCHEDULE) == Course(
        (1_100, 2_600, 5_100), (1_800, 3_100, 5_800), 7_600, Rank((), 7_600, 10_700)
    )


def test_robots_that_need_not_be_together_begin_when_they_are_there() -> None:
    apart = tuple(replace(task, is_together=False) for task in PROBLEM.tasks)
    # Robot 0 works at place 1 from 1.0 to 1.5 s, robot 1 from 1.1 to 1.8 s. Nobody sets out for
    # task 2 before that: robot 1 is there at 2.8 s; robot 0 works at place 0 from 2.5 to 3.0 s, and
    # at place 2 from 5.0 to 5.5 s.
    assert course_of(replace(PROBLEM, tasks=apart), SCHEDULE) == Course(
        (1_000, 2_500, 2_800), (1_800, 3_000, 5_500), 7_500, Rank((), 7_500, 10_300)
    )


@pytest.mark.parametrize(
    ("objective", "home", "cost"),
    [
        (Objective.MAKESPAN, (None, None), 5_800),
        (Objective.MAKESPAN, (None, 1), 6_800),
        (Objective.MEAN_COMPLETION, (0, 2), 1_800 + 3_100 + 5_800),
    ],
)
def test_the_cost_is_by_the_objective(
    objective: Objective, home: tuple[int | None, ...], cost: int
) -> None:
    problem = replace(PROBLEM, objective=objective, home=home)
    assert course_of(problem, SCHEDULE).cost == cost


def test_nobody_sets_out_before_a_task_is_ready() -> None:
    late = (*PROBLEM.tasks[:1], replace(PROBLEM.tasks[1], ready_ms=5_000), PROBLEM.tasks[2])
    assert course_of(replace(PROBLEM, tasks=late), SCHEDULE).begins_ms == (1_100, 6_000, 8_500)


def test_a_task_without_a_place_is_done_where_its_robots_are() -> None:
    anywhere = (PROBLEM.tasks[0], replace(PROBLEM.tasks[1], place=None), PROBLEM.tasks[2])
    # Robot 0 works at place 1 from 1.6 to 2.1 s, and is at place 2 at 3.1 s.
    assert course_of(replace(PROBLEM, tasks=anywhere), SCHEDULE).begins_ms == (1_100, 1_600, 3_100)


@pytest.mark.parametrize(
    ("schedule", "problem"),
    [
        (SCHEDULE[:2], "a schedule of 2 of 3 tasks"),
        ((*SCHEDULE, SCHEDULE[0]), "task 0 is unknown or occurs twice"),
        ((Step(3, ()), *SCHEDULE), "task 3 is unknown or occurs twice"),
        ((SCHEDULE[2], *SCHEDULE[:2]), "task 2 comes before one that it is after"),
        ((Step(0, ((1,), (1,))), *SCHEDULE[1:]), "task 0 needs other robots"),
        ((Step(0, ((0,),)), *SCHEDULE[1:]), "task 0 needs other robots"),
        ((*SCHEDULE[:2], Step(2, ((0, 0),))), "task 2 needs other robots"),
    ],
)
def test_a_schedule_of_another_problem_is_refused(schedule: Schedule, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        course_of(PROBLEM, schedule)


def test_missed_deadlines_go_before_the_objective_those_with_priority_first() -> None:
    tasks = PROBLEM.tasks
    first = replace(tasks[0], level=1, deadline_ms=1_700)
    timed = replace(PROBLEM, tasks=(first, replace(tasks[1], deadline_ms=3_300), tasks[2]))
    late = course_of(timed, SCHEDULE).rank
    assert late.missed == (0, 1)
    assert Rank((0, 2), 1, 1) > late > Rank((0, 0), 99_999, 99_999)
    assert Rank((1, 0), 1, 1) > late
    assert late.is_clearly_better(Rank((0, 2), 1, 1))


@pytest.mark.parametrize(
    ("cost", "other", "is_better"),
    [(99, 9, True), (100, 9, False), (100, 8, True), (101, 1, False)],
)
def test_a_hundredth_less_is_clearly_better(cost: int, other: int, is_better: bool) -> None:
    assert Rank((), cost, other).is_clearly_better(Rank((), 100, 9)) == is_better


def test_a_robot_that_turns_round_where_there_is_an_order_costs_a_twentieth() -> None:
    arrived = tuple(replace(task, arrival=number) for number, task in enumerate(PROBLEM.tasks))
    onward = replace(PROBLEM, tasks=arrived, under_way={0: 0})
    assert course_of(onward, SCHEDULE).rank.cost == 7_600
    turning = replace(onward, under_way={0: 1})
    assert course_of(turning, SCHEDULE).rank.cost == 7_980
    assert course_of(replace(turning, tasks=PROBLEM.tasks), SCHEDULE).rank.cost == 7_600
    urgent = tuple(replace(task, level=number) for number, task in enumerate(PROBLEM.tasks))
    assert course_of(replace(turning, tasks=urgent), SCHEDULE).rank.cost == 7_600
