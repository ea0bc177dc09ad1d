"""The order of tasks in schedules, whatever is proposed."""

from __future__ import annotations

import random
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.scheduling.dispatch import Dispatcher
from mrbt_mesh.core.scheduling.order import by_rules, could_begin, first_tasks, in_order, overtaken
from mrbt_mesh.core.scheduling.problem import (
    SchedulingNeed,
    SchedulingProblem,
    SchedulingTask,
    Step,
    course_of,
)

# Three places on a line, one second apart.
LINE_MS = [[0, 1_000, 2_000], [1_000, 0, 1_000], [2_000, 1_000, 0]]


def single(place: int, *robots: int, **more: int | None) -> SchedulingTask:
    need = SchedulingNeed(1, dict.fromkeys(robots or (0, 1), 100))
    return replace(SchedulingTask(place, (need,)), **more)


def problem(*tasks: SchedulingTask, robots: int = 1) -> SchedulingProblem:
    return SchedulingProblem(
        tasks, (0,) * robots, (0,) * robots, [LINE_MS] * robots, (None,) * robots
    )


def begun(of: SchedulingProblem, *order: int) -> dict[int, int]:
    """Robot -> its first task, where this order is proposed."""
    return first_tasks(of, in_order(of, Dispatcher(of), order, {}).schedule)


def test_a_task_with_priority_goes_first() -> None:
    of = problem(single(0, 0, level=1), single(2, 0, level=0))
    assert begun(of, 0, 1) == {0: 1}


def test_a_task_is_overtaken_while_it_has_some_to_spare() -> None:
    near, far = single(0, 0, arrival=1), single(2, 0, arrival=0)
    assert begun(problem(near, replace(far, spare=1)), 0, 1) == {0: 0}
    assert begun(problem(near, replace(far, spare=0)), 0, 1) == {0: 1}


def test_two_robots_that_begin_at_once_overtake_twice() -> None:
    far = single(2, arrival=0, spare=1)
    of = problem(far, single(0, arrival=1), single(0, arrival=2), robots=2)
    assert 0 in begun(of, 1, 2, 0).values()


def test_the_last_robot_of_a_coalition_overtakes_what_it_could_have_begun() -> None:
    """What it begins is not open any more, and it counts as at work."""
    of = replace(problem(single(2, 0), single(0, 1), robots=3), at_work=frozenset({0}))
    dispatcher = Dispatcher(of)
    assert could_begin(of, dispatcher, {}, 0, 0)
    assert not could_begin(of, dispatcher, {}, 1, 0), "it cannot do that"
    assert not could_begin(of, dispatcher, {1: 0}, 0, 0), "another robot does it"


def test_a_robot_on_its_way_turns_round_for_priority_alone() -> None:
    far = single(2, 0, arrival=0, spare=0)
    later = replace(problem(far, single(1, 0, arrival=1)), under_way={0: 1})
    assert begun(later, 1, 0) == {0: 1}
    lower = replace(problem(far, single(1, 0, level=1)), under_way={0: 1})
    assert begun(lower, 1, 0) == {0: 0}


def test_a_robot_at_the_place_goes_before_a_distant_one_for_priority() -> None:
    """Also if the distant one has set out, while the one at the place did something else."""
    able = {0: 100, 1: 100, 2: 100}
    pair = SchedulingTask(0, (SchedulingNeed(2, able),), level=0)
    near = single(0, *able, level=1)
    of = replace(problem(pair, near, robots=3), at=(0, 0, 2))
    crew = {0: ((0, 2),), 1: ((1,),)}
    for under_way in ({}, {0: 0, 2: 0}):
        found = in_order(replace(of, under_way=under_way), Dispatcher(of), [0, 1], crew)
        assert first_tasks(of, found.schedule) == {0: 0, 1: 0}


def test_a_robot_that_is_hardly_sooner_leaves_a_task_with_priority_to_others() -> None:
    able = {0: 100, 1: 100, 2: 100}
    pair = SchedulingTask(0, (SchedulingNeed(2, able),), level=0)
    of = replace(problem(pair, single(1, *able, level=1), robots=3), at=(0, 1, 2))
    found = in_order(of, Dispatcher(of), [0, 1], {0: ((0, 2),), 1: ((1,),)})
    assert first_tasks(of, found.schedule) == {0: 0, 1: 1, 2: 0}


def test_what_is_not_asked_for_or_lacks_robots_is_not_overtaken() -> None:
    near, far = single(0, 0, arrival=1), single(2, 0, arrival=0, spare=0)
    assert begun(problem(near, replace(far, is_asked=False)), 0, 1) == {0: 0}
    pair = replace(far, needs=(SchedulingNeed(2, {0: 100, 1: 100}),))
    busy = replace(problem(near, pair, robots=2), at_work=frozenset({1}), free_ms=(0, 500))
    assert begun(busy, 0, 1) == {0: 0}


def drawn(seed: int) -> SchedulingProblem:
    pick = random.Random(seed)
    robots = range(pick.randint(1, 4))
    tasks = []
    for _ in range(pick.randint(2, 7)):
        able = [robot for robot in robots if pick.random() < 0.7] or [0]
        count = pick.randint(1, min(2, len(able)))
        need = SchedulingNeed(count, {robot: pick.randint(50, 900) for robot in able})
        late = pick.choice([None, pick.randint(100, 4_000)])
        ready = SchedulingTask(pick.choice([0, 1, 2]), (need,), level=pick.randint(0, 2))
        order = {"arrival": pick.randint(0, 9), "spare": pick.randint(0, 2)}
        tasks.append(replace(ready, is_asked=pick.random() < 0.8, deadline_ms=late, **order))
    of = problem(*tasks, robots=len(robots))
    under_way = {robot: pick.randrange(len(tasks)) for robot in robots if pick.random() < 0.3}
    under_way = {
        robot: goal for robot, goal in under_way.items() if robot in tasks[goal].needs[0].work_ms
    }
    return replace(of, under_way=under_way)


@given(st.integers(0, 100_000))
def test_no_proposal_breaks_the_order(seed: int) -> None:
    of, pick = drawn(seed), random.Random(seed)
    dispatcher = Dispatcher(of)
    order = list(range(len(of.tasks)))
    pick.shuffle(order)
    for found in (in_order(of, dispatcher, order, {}), *by_rules(of, dispatcher)):
        assert course_of(of, found.schedule).rank == found.rank, seed
        first = first_tasks(of, found.schedule)
        for number, task in enumerate(of.tasks):
            if task.is_asked:
                lower, later, _ = overtaken(of, dispatcher, first, number)
                assert not lower, seed
                assert task.spare is None or len(later) <= task.spare, seed


def test_a_hint_is_kept_and_completed() -> None:
    of = problem(single(2), robots=2)
    hinted = in_order(of, Dispatcher(of), [0], {0: ((1,),)})
    assert hinted.schedule == (Step(0, ((1,),)),)


def test_a_hint_that_leaves_another_need_without_robots_is_dropped() -> None:
    needs = SchedulingNeed(1, {0: 100, 1: 100}), SchedulingNeed(1, {0: 100})
    of = problem(SchedulingTask(0, needs), robots=2)
    hinted = in_order(of, Dispatcher(of), [0], {0: ((0,), ())})
    assert hinted.schedule == (Step(0, ((1,), (0,))),)
