"""`assignment: spare_scarce`: who cannot be replaced is kept for what nobody else can do."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.assignment.problem import AssignmentProblem, Solver
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.mission.mission import AssignmentPolicy, Mission, mission_from_json
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan
from tests.support.build import (
    World,
    action,
    condition,
    fallback,
    make_mission,
    parallel,
    sequence,
    task,
)
from tests.support.strategies import worlds

LOOKS = ("look1", "look2")


def sparing(mission: Mission) -> World:
    return World(replace(mission, assignment=AssignmentPolicy.SPARE_SCARCE))


def who(plan: Plan) -> dict[str, str]:
    return {robot: line.global_task for robot, line in plan.assignments.items()}


def specialist(later: bool = True) -> Mission:
    """A alone can weld, A and B can look: looking twice comes first, welding perhaps later."""
    robots = {"A": {"look": 1.0, "weld": 1.0}, "B": {"look": 1.0}}
    tasks = [
        task("look1", ("look", 1, 1)),
        task("look2", ("look", 1, 1)),
        task("w", ("weld", 1, 1)),
    ]
    looks = parallel(2, *map(action, LOOKS))
    return make_mission(sequence(looks, action("w")) if later else looks, robots, tasks)


def test_the_specialist_waits_and_the_other_one_looks_twice() -> None:
    assert who(World(specialist()).plan()) == {"A": "look1", "B": "look2"}
    world = sparing(specialist())
    plan = world.plan()
    assert who(plan) == {"B": "look1"}
    assert plan.idle == {"A": "look1, look2: spared for what fewer robots can do"}
    assert [(w.global_task, w.is_blocked) for w in plan.waiting] == [("look2", False)]
    assert "busy" in plan.waiting[0].reason
    world.outcome(world.activation("look1"), True, "B", "look")
    assert who(world.plan()) == {"B": "look2"}


def test_nothing_is_spared_for_what_is_not_asked_for() -> None:
    assert who(sparing(specialist(later=False)).plan()) == {"A": "look1", "B": "look2"}


def test_the_specialist_helps_once_nobody_else_is_left() -> None:
    world = sparing(specialist())
    world.die("B")
    assert who(world.plan()) == {"A": "look1"}


def test_being_the_only_one_weighs_more_than_being_one_of_two_for_many_tasks() -> None:
    robots = {
        "A": {"look": 1.0, "weld": 1.0},
        "B": {"look": 1.0, "lift": 1.0, "mend": 1.0, "paint": 1.0},
        "C": {"lift": 1.0, "mend": 1.0, "paint": 1.0},
    }
    later = [action(each) for each in ("weld", "lift", "mend", "paint")]
    mission = make_mission(sequence(action("look"), *later), robots)
    assert who(World(mission).plan()) == {"A": "look"}
    assert who(sparing(mission).plan()) == {"B": "look"}


def test_two_that_are_wanted_are_the_two_that_are_needed_least() -> None:
    carriers = {each: {"carry": 1.0} for each in "ABC"}
    robots = {**carriers, "A": {"carry": 1.0, "weld": 1.0}, "B": {"carry": 1.0, "look": 1.0}}
    robots["D"] = {"look": 1.0}
    tasks = [task("pair", ("carry", 2, 2))]
    tree = sequence(action("pair"), action("weld"), action("look"))
    mission = make_mission(tree, robots, tasks)
    assert who(World(mission).plan()) == {"A": "pair", "B": "pair"}
    assert who(sparing(mission).plan()) == {"B": "pair", "C": "pair"}


def test_what_is_done_needs_nobody_any_more() -> None:
    robots = {"A": {"look": 1.0, "weld": 1.0}, "B": {"look": 1.0}}
    tasks = [task("see", ("look", 1, 1)), task("w", ("weld", 1, 1))]
    tree = parallel(2, fallback(condition("welded"), action("w")), action("see"))
    world = sparing(make_mission(tree, robots, tasks))
    assert who(world.plan()) == {"A": "w", "B": "see"}
    world = sparing(
        replace(
            world.mission,
            conditions={"welded": replace(world.mission.conditions["welded"], default=True)},
        )
    )
    # A and B are equals now, and the canonical order decides.
    assert who(world.plan()) == {"A": "see"}


def test_a_begun_request_gets_the_robots_that_it_lacks() -> None:
    """B has begun to carry, the only other carrier is indispensable elsewhere: it joins in."""
    robots = {"A": {"carry": 1.0, "weld": 1.0}, "B": {"carry": 1.0}, "C": {"carry": 1.0}}
    tasks = [
        task("pair", ("carry", 2, 2)),
        task("single", ("carry", 1, 1)),
        task("w", ("weld", 1, 1)),
    ]
    tree = sequence(parallel(2, action("pair"), action("single")), action("w"))
    world = sparing(make_mission(tree, robots, tasks))
    assert who(world.plan()) == {"B": "pair", "C": "pair"}
    world.claim("B", world.activation("pair"), "carry")
    world.claim("C", world.activation("single"), "carry")
    assert who(world.plan()) == {"A": "pair", "B": "pair", "C": "single"}


def test_a_request_that_needs_different_robots_for_its_parts_is_never_starved() -> None:
    """B is the least needed for both parts, but cannot do both."""
    robots = {"A": {"lift": 1.0, "look": 1.0, "weld": 1.0}, "B": {"lift": 1.0, "look": 1.0}}
    tasks = [task("both", ("lift", 1, 1), ("look", 1, 1)), task("w", ("weld", 1, 1))]
    world = sparing(make_mission(sequence(action("both"), action("w")), robots, tasks))
    assert who(world.plan()) == {"A": "both", "B": "both"}


@given(worlds())
def test_what_a_team_at_rest_can_begin_it_begins(world: World) -> None:
    """The first request that anybody could serve is served, and what is blocked stays the same."""
    usual, careful = world.plan(), sparing(world.mission).plan()
    served = [r.activation for r in usual.evaluation.requests]
    for waiting in usual.waiting:
        served.remove(waiting.activation)
    stay = {w.activation for w in careful.waiting}
    if served:
        assert served[0] not in stay
    blocked = [w.activation for w in usual.waiting if w.is_blocked]
    assert [w.activation for w in careful.waiting if w.is_blocked] == blocked


def turned(solver: Solver) -> Solver:
    """The same solver, given the robots and the demands in the opposite order."""

    def solve(problem: AssignmentProblem) -> list[int] | None:
        last = len(problem.demands) - 1
        rows = [{last - d: p for d, p in row.items()} for row in reversed(problem.performance)]
        answer = solver(AssignmentProblem.of(problem.robots[::-1], problem.demands[::-1], rows))
        return None if answer is None else [d if d < 0 else last - d for d in reversed(answer)]

    return solve


@given(worlds(), st.data())
def test_the_plan_is_the_same_whichever_optimum_a_solver_finds(
    world: World, data: st.DataObject
) -> None:
    careful = sparing(world.mission)
    for robot in careful.alive:
        lines = careful.plan().assignments
        if robot in lines and data.draw(st.booleans()):
            careful.claim(robot, lines[robot].activation, lines[robot].local_task)
    other = make_plan(careful.facts, careful.alive, turned(min_cost_flow))
    assert careful.plan().packed == other.packed


@given(worlds(), st.data())
def test_who_has_begun_goes_on_where_it_would_under_the_usual_assignment(
    world: World, data: st.DataObject
) -> None:
    careful, usual = sparing(world.mission), world
    for robot in careful.alive:
        lines = careful.plan().assignments
        if robot in lines and data.draw(st.booleans()):
            for each in (careful, usual):
                line = lines[robot]
                each.claim(robot, line.activation, line.local_task)
    pinned = {robot for robot, line in usual.plan().assignments.items() if line.pinned}
    assert {robot for robot, line in careful.plan().assignments.items() if line.pinned} == pinned


@pytest.mark.parametrize("how", list(AssignmentPolicy))
def test_it_is_part_of_the_digest_and_of_compiled_missions(how: AssignmentPolicy) -> None:
    mission = replace(specialist(), assignment=how)
    assert mission_from_json(mission.to_json()).assignment is how
    assert (mission.digest == specialist().digest) == (how is AssignmentPolicy.ANY)
