"""The plan: the same bytes for the same facts, a digest of who does what, and explanations."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.store import Incarnation
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


def repair() -> World:
    """Two big robots take the cover off, then two parts are fixed at once."""
    robots = {
        "A1": {"diagnose": 1.0, "fix": 0.9},
        "B1": {"diagnose": 0.8, "fix": 0.8},
        "C1": {"lift": 1.0},
        "C2": {"lift": 1.0},
    }
    tasks = [
        task("cover", ("lift", 2, 2)),
        task("part1", ("diagnose", 1, 1)),
        task("part2", ("fix", 1, 2)),
    ]
    tree = sequence(action("cover"), parallel(2, action("part1"), action("part2")))
    return World(make_mission(tree, robots, tasks))


def who_does_what(world: World) -> dict[str, str]:
    return {robot: line.global_task for robot, line in world.plan().assignments.items()}


def uncover(world: World) -> None:
    for robot in ("C1", "C2"):
        world.outcome(world.activation("cover"), True, robot, "lift")


# -- who does what ----------------------------------------------------------------------------


def test_robots_go_where_the_sum_of_performances_is_greatest() -> None:
    world = repair()
    assert who_does_what(world) == {"C1": "cover", "C2": "cover"}
    uncover(world)
    # A1 would fix better than B1, but 1.0 + 0.8 is more than 0.8 + 0.9.
    assert who_does_what(world) == {"A1": "part1", "B1": "part2"}


def test_a_running_robot_keeps_its_place_where_another_would_be_better() -> None:
    world = repair()
    uncover(world)
    world.claim("B1", world.activation("part1"), "diagnose")
    plan = world.plan()
    assert who_does_what(world) == {"A1": "part2", "B1": "part1"}
    assert [plan.assignments[robot].pinned for robot in ("A1", "B1")] == [False, True]


def test_a_dead_robot_is_replaced() -> None:
    world = repair()
    uncover(world)
    world.claim("A1", world.activation("part1"), "diagnose")
    world.die("A1")
    assert who_does_what(world) == {"B1": "part1"}


def test_with_one_robot_requests_are_served_one_after_the_other() -> None:
    world = World(make_mission(parallel(2, action("a"), action("b")), {"R1": {"a": 1, "b": 1}}))
    assert who_does_what(world) == {"R1": "a"}
    world.succeed("a")
    assert who_does_what(world) == {"R1": "b"}
    world.succeed("b")
    assert world.plan().result is Status.SUCCESS


def test_partners_are_the_others_on_the_same_local_task() -> None:
    world = repair()
    plan = world.plan()
    assert (plan.partners("C1"), plan.partners("C2")) == (("C2",), ("C1",))


def test_robots_beyond_nu_join_up_to_mu() -> None:
    lift = task("lift", ("lift", 1, 2))
    team = {name: {"lift": 1.0} for name in "ABC"}
    assert who_does_what(World(make_mission(action("lift"), team, [lift]))) == {
        "A": "lift",
        "B": "lift",
    }


# -- explanations -----------------------------------------------------------------------------


def test_a_blocked_request_says_what_is_short_and_by_how_many() -> None:
    robots = {"C1": {"move_frame": 1.0}, "C2": {"move_frame": 1.0}}
    cover = task("remove_cover", ("move_frame", 2, 2))
    world = World(make_mission(action("remove_cover"), robots, [cover]))
    assert world.plan().waiting == ()
    world.die("C2")
    plan = world.plan()
    assert [w.reason for w in plan.waiting] == ["blocked: move_frame needs 2, 1 alive"]
    assert world.idle() == {"C1": "remove_cover: waits for robots"}
    assert plan.to_json()["waiting"][0]["blocked"] is True


def test_a_request_that_waits_for_busy_robots_is_not_blocked() -> None:
    world = World(make_mission(parallel(2, action("a"), action("b")), {"R1": {"a": 1, "b": 1}}))
    (waiting,) = world.plan().waiting
    assert (waiting.global_task, waiting.shortages) == ("b", ())
    assert waiting.reason == "waiting: the robots it needs are busy with earlier requests"


def test_every_robot_has_a_line_or_is_idle_and_never_both() -> None:
    world = repair()
    plan = world.plan()
    assert set(plan.assignments) | set(plan.idle) == set(world.alive)
    assert not set(plan.assignments) & set(plan.idle)


# -- the operator's commands ------------------------------------------------------------------


@pytest.mark.parametrize("command", ["pause", "abort"])
def test_a_command_takes_everybodys_task_away(command: str) -> None:
    world = repair()
    world.order(command)
    plan = world.plan()
    assert (plan.assignments, plan.waiting) == ({}, ())
    assert set(world.idle().values()) == {f"the operator's command is {command}"}
    assert plan.result is (Status.FAILURE if command == "abort" else Status.RUNNING)


def test_resuming_gives_the_tasks_back() -> None:
    world = repair()
    before = world.plan().digest
    world.order("pause")
    assert world.plan().digest != before
    world.order("resume", 2)
    assert world.plan().digest == before


# -- the same plan on every robot -------------------------------------------------------------


@st.composite
def histories(draw: st.DrawFn) -> World:
    """Random tasks and robots in the middle of their work."""
    world = draw(worlds())
    for _ in range(draw(st.integers(0, 8))):
        requests = world.tick().requests
        robots = sorted(world.alive)
        if not requests or not robots:
            break
        request, robot = draw(st.sampled_from(requests)), draw(st.sampled_from(robots))
        needs = world.mission.global_tasks[request.subject].needs
        local = draw(st.sampled_from(needs)).local_task
        match draw(st.integers(0, 3)):
            case 0:
                world.outcome(request.activation, draw(st.booleans()), robot, local)
            case 1:
                world.die(robot)
            case _:
                since = draw(st.integers(0, 3))
                world.claim(robot, request.activation, local, draw(st.booleans()), since)
    return world


@given(histories(), st.integers())
def test_facts_received_in_any_order_give_the_same_bytes(world: World, seed: int) -> None:
    world.tick()
    entries = list(world.entries)
    random.Random(seed).shuffle(entries)
    other = world.replayed(entries)
    other.alive = dict(reversed(other.alive.items()))
    assert other.plan().packed == world.plan().packed
    assert other.plan().digest == world.plan().digest


def once_all_have_let_go(world: World) -> Plan:
    """The plan once each robot has stopped what the plan takes from it.

    Until then somebody else's start may let its pin hold again: the plan then goes by that.
    """
    while True:
        plan = world.plan()
        pinned = {robot for robot, line in plan.assignments.items() if line.pinned}
        others = sorted(world.alive.keys() & world.facts.claims.keys() - pinned)
        if not others:
            return plan
        for robot in others:
            world.write(robot, (records.CLAIM, None))


@given(histories(), st.data())
def test_claims_and_phases_that_the_plan_already_contains_leave_the_digest_alone(
    world: World, data: st.DataObject
) -> None:
    plan = once_all_have_let_go(world)
    for robot, line in plan.assignments.items():
        if data.draw(st.booleans()):
            running = data.draw(st.booleans()) or line.pinned
            since = 1 if line.pinned else 9
            world.claim(robot, line.activation, line.local_task, running, since)
    assert world.plan().digest == plan.digest


@given(histories())
def test_a_plan_keeps_every_bound_and_asks_nobody_for_what_it_cannot_do(world: World) -> None:
    plan = world.plan()
    waiting = {each.activation for each in plan.waiting}
    for request in plan.evaluation.requests:
        for need in world.mission.global_tasks[request.subject].needs:
            on_it = [
                line.robot
                for line in plan.assignments.values()
                if (line.activation, line.local_task) == (request.activation, need.local_task)
            ]
            results = world.facts.results(request.activation, need.local_task)
            assert not set(on_it) & set(results)
            lower = max(0, need.min_robots - sum(results.values()))
            upper = max(lower, need.max_robots - len(results))
            assert len(on_it) <= upper
            if request.activation not in waiting:
                assert len(on_it) >= lower
            for robot in on_it:
                assert need.local_task in world.facts.members[robot].member.capabilities
                assert robot in world.alive
    served = {request.activation for request in plan.evaluation.requests} - waiting
    assert plan.consistent is plan.feasible
    assert plan.feasible or not served
    assert set(plan.assignments) | set(plan.idle) == set(world.alive)


def test_the_problem_is_infeasible_when_no_request_can_be_served() -> None:
    tasks = [task("cover", ("lift", 2, 2)), task("part", ("look", 1, 1))]
    robots = {"A": {"lift": 1.0, "look": 1.0}, "B": {"lift": 1.0}, "C": {"look": 1.0}}
    world = World(make_mission(parallel(2, action("cover"), action("part")), robots, tasks))
    world.die("C")
    # Waiting for a robot that is busy is no failure, nor being blocked beside what is served.
    assert (world.plan().consistent, world.plan().feasible) == (True, True)
    assert [each.global_task for each in world.plan().waiting] == ["part"]
    world.die("B")
    assert [each.global_task for each in world.plan().waiting] == ["cover"]
    assert world.plan().feasible
    world.die("A")
    assert [each.global_task for each in world.plan().waiting] == ["cover", "part"]
    assert (world.plan().consistent, world.plan().feasible) == (False, False)
    # The operator's word is no failure: nothing is asked for.
    world.order("pause")
    assert world.plan().feasible


def test_nothing_to_be_assigned_is_a_solved_problem() -> None:
    robots, tasks = {"A": {"look": 1.0}}, [task("part", ("look", 1, 1))]
    world = World(make_mission(sequence(condition("c"), action("part")), robots, tasks))
    assert not world.plan().evaluation.requests
    assert world.plan().feasible


def test_the_digest_tells_different_work_apart() -> None:
    world = repair()
    digests = {world.plan().digest}
    world.die("C1")
    digests.add(world.plan().digest)
    world.join("C1", {"lift": 1}, life=2)
    uncover(world)
    digests.add(world.plan().digest)
    world.claim("B1", world.activation("part1"), "diagnose")
    digests.add(world.plan().digest)
    assert len(digests) == 4


def test_the_alive_set_alone_does_not_change_the_digest() -> None:
    world = repair()
    before = world.plan().digest
    world.die("A1")
    assert world.plan().digest == before


def test_a_robot_counts_only_in_the_life_that_is_alive() -> None:
    world = repair()
    alive = world.alive | {"C1": Incarnation(7, "other")}
    plan = make_plan(world.facts, alive, min_cost_flow)
    assert "C1" not in plan.assignments


def test_a_fallback_gets_its_turn_when_the_first_way_has_failed() -> None:
    tasks = [task("quick", ("look", 1, 1)), task("slow", ("lift", 1, 1))]
    robots = {"A": {"look": 1.0}, "B": {"lift": 1.0}}
    world = World(make_mission(fallback(action("quick"), action("slow")), robots, tasks))
    assert who_does_what(world) == {"A": "quick"}
    world.outcome(world.activation("quick"), False, "A", "look")
    assert who_does_what(world) == {"B": "slow"}
