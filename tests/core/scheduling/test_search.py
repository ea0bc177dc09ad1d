"""Every order leads to a schedule that can be carried out; the search comes near the optimum."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, permutations, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.scheduling.dispatch import Dispatcher
from mrbt_mesh.core.scheduling.order import mended
from mrbt_mesh.core.scheduling.problem import (
    Crew,
    Objective,
    SchedulingNeed,
    SchedulingProblem,
    SchedulingTask,
    Step,
    course_of,
)
from mrbt_mesh.core.scheduling.search import search


def drawn(
    seed: int, robots: int, tasks: int, kinds: int = 2, precedence: bool = False
) -> SchedulingProblem:
    """Robots of several kinds and tasks at places in a plane; `seed` reproduces it."""
    draw = random.Random(seed)
    places = [(draw.randrange(5_000), draw.randrange(5_000)) for _ in range(tasks + robots)]
    ways_ms = [[abs(a - c) + abs(b - d) for c, d in places] for a, b in places]
    able = [{r: draw.randrange(500, 5_000) for r in range(k, robots, kinds)} for k in range(kinds)]
    found = []
    for number in range(tasks):
        needs = tuple(
            SchedulingNeed(draw.randrange(1, min(2, len(each)) + 1), each)
            for each in draw.sample(able, draw.randrange(1, kinds + 1))
        )
        after = tuple(
            each for each in range(number) if precedence and draw.random() < 1 / (1 + number)
        )
        place = None if precedence and number % 4 == 3 else number
        is_together, ready_ms = draw.random() < 0.7, draw.choice((0, 0, 3_000))
        found.append(SchedulingTask(place, needs, after, is_together, ready_ms))
    home = tuple(draw.choice((None, tasks + robot)) for robot in range(robots))
    return SchedulingProblem(
        tuple(found),
        tuple(draw.choice((0, 2_000)) for _ in range(robots)),
        tuple(range(tasks, tasks + robots)),
        (ways_ms,) * robots,
        home,
        draw.choice(list(Objective)),
    )


def crews(task: SchedulingTask) -> Iterator[Crew]:
    return product(*(combinations(sorted(need.work_ms), need.robots) for need in task.needs))


def least_cost(problem: SchedulingProblem) -> int:
    """Of all schedules that there are."""
    choices = [list(crews(task)) for task in problem.tasks]
    numbers, costs = range(len(problem.tasks)), []
    for order in permutations(numbers):
        for chosen in product(*(choices[number] for number in order)):
            try:
                schedule = tuple(map(Step, order, chosen))
                costs.append(course_of(problem, schedule).cost)
            except ValueError:
                break  # it comes before a task that it is after, with whatever robots
    return min(costs)


@given(st.integers(0, 10_000), st.integers(2, 9), st.integers(1, 9), st.booleans(), st.randoms())
def test_every_order_can_be_carried_out_at_the_cost_that_is_foretold(
    seed: int, robots: int, tasks: int, precedence: bool, shuffled: random.Random
) -> None:
    problem = drawn(seed, robots, tasks, precedence=precedence)
    order = list(range(tasks))
    shuffled.shuffle(order)
    found = Dispatcher(problem).dispatch(order)
    course = course_of(problem, found.schedule)
    assert (course.cost, course.rank) == (found.cost, found.rank)


@given(st.integers(0, 10_000), st.integers(2, 9), st.integers(1, 9), st.randoms())
def test_robots_that_gather_one_for_each_need_are_chosen_as_others_are(
    seed: int, robots: int, tasks: int, shuffled: random.Random
) -> None:
    problem = drawn(seed, robots, tasks)
    single = tuple(
        replace(task, needs=tuple(replace(need, robots=1) for need in task.needs))
        for task in problem.tasks
    )
    dispatcher = Dispatcher(replace(problem, tasks=single))
    order = list(range(tasks))
    shuffled.shuffle(order)
    found = dispatcher.dispatch(order)
    dispatcher._is_simple = [False] * tasks
    assert dispatcher.dispatch(order) == found


def test_a_robot_that_could_serve_two_needs_serves_the_one_that_fewer_can() -> None:
    needs = (SchedulingNeed(1, {0: 10, 1: 20}), SchedulingNeed(1, {0: 10}))
    problem = SchedulingProblem(
        (SchedulingTask(0, needs),), (0, 0), (0, 0), ([[0]],) * 2, (None, None)
    )
    assert Dispatcher(problem).dispatch([0]).schedule == (Step(0, ((1,), (0,))),)
    lacking = replace(problem, tasks=(SchedulingTask(0, needs[1:] * 2),))
    with pytest.raises(ValueError, match="task 0 lacks robots"):
        Dispatcher(lacking).dispatch([0])


def test_tasks_after_one_another_in_a_circle_are_refused() -> None:
    tasks = (
        SchedulingTask(0, (SchedulingNeed(1, {0: 1}),), (1,)),
        SchedulingTask(0, (SchedulingNeed(1, {0: 1}),), (0,)),
    )
    with pytest.raises(ValueError, match="in a circle"):
        Dispatcher(SchedulingProblem(tasks, (0,), (0,), ([[0]],), (None,))).dispatch([0, 1])


def test_small_problems_are_solved_within_a_hundredth_of_the_optimum_on_average() -> None:
    ratios = []
    for seed in range(40):
        problem = drawn(seed, robots=3, tasks=4, precedence=seed % 2 == 1)
        best, found = least_cost(problem), search(problem, 500, seed)
        assert found.cost >= best, seed
        ratios.append(found.cost / best)
    assert sum(ratios) / len(ratios) <= 1.01, ratios


@pytest.mark.parametrize("seed", range(20))
def test_what_is_found_keeps_the_order_of_tasks(seed: int) -> None:
    """Robots mend what breaks it: what that comes to is what was searched for."""
    draw, of = random.Random(seed), drawn(seed, 4, 6)
    tasks = (replace(each, level=draw.randrange(3), spare=draw.randrange(3)) for each in of.tasks)
    of = replace(of, tasks=tuple(tasks))
    found = search(of, 50, seed)
    proposed = {step.task: step.crew for step in found.schedule}
    assert mended(of, Dispatcher(of), list(proposed), proposed).rank <= found.rank, seed


def test_more_evaluations_and_a_known_order_are_never_worse() -> None:
    problem = drawn(1, robots=6, tasks=12)
    rules, longer = search(problem, 0, 1), search(problem, 800, 1)
    assert longer.cost < rules.cost
    known = [step.task for step in longer.schedule]
    assert search(problem, 0, 1, known).cost <= longer.cost


def test_the_same_problem_and_seed_have_the_same_schedule_on_every_machine() -> None:
    found = [search(drawn(seed, 6, 12, precedence=True), 200, seed) for seed in range(5)]
    steps = [[tuple(step) for step in each.schedule] for each in found]
    digest = hashlib.sha256(repr(steps).encode()).hexdigest()
    assert digest[:16] == "3f76a531116e8b82"
