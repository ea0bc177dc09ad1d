"""Demands and *Check Consistency*: bounds, pins, and which requests are kept."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import NodeSpec
from mrbt_mesh.core.planning.capabilities import Worker, capabilities_of, workers
from mrbt_mesh.core.planning.consistency import Consistency, kept_requests, shortages
from mrbt_mesh.core.planning.demands import Demand, demands_of
from tests.support.build import World, action, make_mission, parallel, task
from tests.support.strategies import worlds

LIFT = "r1:0:lift::0"


def lifters(needed: int, allowed: int, *names: str) -> World:
    """One request that needs lifting, and robots that can all lift."""
    robots = {name: {"lift": 1} for name in names or ("A", "B", "C", "D")}
    return World(make_mission(action("lift"), robots, [task("lift", ("lift", needed, allowed))]))


def all_demands(world: World) -> list[tuple[Demand, ...]]:
    capabilities = capabilities_of(world.facts, world.alive)
    return demands_of(world.facts, world.tick().requests, capabilities)


def demand(world: World) -> Demand:
    ((only,),) = all_demands(world)
    return only


def kept(world: World) -> tuple[list[int], dict[str, int]]:
    team = workers(world.facts, world.alive)
    return kept_requests(world.facts, all_demands(world), lambda: Consistency(team))


# -- bounds -----------------------------------------------------------------------------------


def test_bounds_begin_with_nu_and_mu() -> None:
    found = demand(lifters(2, 3))
    assert (found.lower, found.upper, found.pinned) == (2, 3, ())
    assert list(found.candidates) == ["A", "B", "C", "D"]


@pytest.mark.parametrize(
    ("script", "lower", "upper"),
    [
        ("A+", 1, 2),
        ("A-", 2, 2),
        ("A- B-", 2, 2),
        ("A+ B-", 1, 1),
        ("A- B- C-", 2, 2),
        ("A+ B- C-", 1, 1),
    ],
)
def test_bounds_shrink_as_local_tasks_finish(script: str, lower: int, upper: int) -> None:
    world = lifters(2, 3, *"ABCDE")
    for robot, event in script.split():
        world.outcome(LIFT, event == "+", robot)
    found = demand(world)
    assert (found.lower, found.upper) == (lower, upper)


def test_a_robot_with_an_outcome_is_not_assigned_again() -> None:
    world = lifters(2, 3)
    world.outcome(LIFT, False, "A")
    world.claim("A", LIFT)
    assert list(demand(world).candidates) == ["B", "C", "D"]
    assert demand(world).pinned == ()


def test_once_successes_reach_nu_nobody_new_is_assigned() -> None:
    robots = {name: {"lift": 1, "look": 1} for name in "ABCD"}
    both = task("both", ("lift", 1, 3), ("look", 1, 1))
    world = World(make_mission(action("both"), robots, [both]))
    name = world.activation("both")
    world.outcome(name, True, "A", "lift")
    world.claim("B", name, "lift")
    lift, look = all_demands(world)[0]
    assert (lift.lower, lift.upper, lift.pinned) == (0, 1, ("B",))
    assert (look.lower, look.upper) == (1, 1)


@pytest.mark.parametrize(
    ("script", "upper"), [("", 2), ("A+", 1), ("A-", 1), ("A+ B+", 0), ("A+ B- C+", 0)]
)
def test_where_nobody_has_to_help_as_many_may_as_are_allowed(script: str, upper: int) -> None:
    """A success there ends nothing: it is the other need that the task waits for."""
    robots = {name: {"hold": 1} for name in "ABCD"} | {"E": {"lift": 1}}
    both = task("both", ("lift", 1, 1), ("hold", 0, 2))
    world = World(make_mission(action("both"), robots, [both]))
    for robot, event in script.split():
        world.outcome(world.activation("both"), event == "+", robot, "hold")
    lift, hold = all_demands(world)[0]
    assert (lift.lower, lift.upper) == (1, 1)
    assert (hold.lower, hold.upper) == (0, upper)


def test_nobody_is_kept_from_a_request_by_those_who_might_help() -> None:
    robots = {"A": {"hold": 2, "lift": 1}, "B": {"lift": 1}}
    first, second = task("first", ("lift", 1, 1), ("hold", 0, 2)), task("second", ("lift", 1, 1))
    tree = parallel(2, action("first"), action("second"))
    world = World(make_mission(tree, robots, [first, second]))
    lines = world.plan().assignments
    assert {robot: line.local_task for robot, line in lines.items()} == {"A": "lift", "B": "lift"}
    world.outcome(world.activation("second"), True, "B", "lift")
    lines = world.plan().assignments
    assert {robot: line.local_task for robot, line in lines.items()} == {"A": "hold", "B": "lift"}


def test_who_is_missing_is_told_and_not_who_might_help() -> None:
    """Each could be served, not both: B cannot lift and look at the same time."""
    needs = ("lift", 1, 1), ("look", 1, 1), ("hold", 0, 1)
    world = World(make_mission(action("all"), {"B": {"lift": 1, "look": 1}}, [task("all", *needs)]))
    (waiting,) = world.plan().waiting
    assert waiting.reason == "blocked: lift needs 1, 1 alive; look needs 1, 1 alive"


# -- who may work -----------------------------------------------------------------------------


def test_only_robots_that_are_alive_known_staying_and_in_their_newest_life_may_work() -> None:
    world = lifters(1, 1, *"ABCDE")
    world.die("A")
    world.leave("B")
    world.alive["C"] = world.alive["C"]._replace(counter=2)
    world.alive["Z"] = world.alive["D"]
    assert list(workers(world.facts, world.alive)) == ["D", "E"]


def test_a_robot_that_lost_the_capability_is_no_candidate_and_no_pin() -> None:
    world = lifters(1, 2)
    world.claim("A", LIFT)
    world.lose("A", "lift")
    assert "A" not in demand(world).candidates
    assert demand(world).pinned == ()


# -- pins -------------------------------------------------------------------------------------


def test_a_running_claim_pins_and_a_claimed_one_does_not() -> None:
    world = lifters(1, 2)
    world.claim("B", LIFT, running=True)
    world.claim("A", LIFT, running=False)
    assert demand(world).pinned == ("B",)


def test_at_most_mu_claims_pin_in_their_canonical_order() -> None:
    world = lifters(1, 2)
    for robot, since in (("A", 9), ("B", 3), ("C", 3), ("D", 1)):
        world.claim(robot, LIFT, since=since)
    assert demand(world).pinned == ("D", "B")


def test_outcomes_leave_fewer_places_for_pins() -> None:
    world = lifters(1, 2)
    world.outcome(LIFT, False, "D")
    world.claim("A", LIFT, since=2)
    world.claim("B", LIFT, since=1)
    assert demand(world).pinned == ("B",)


def test_claims_on_what_is_no_longer_requested_pin_nobody() -> None:
    world = lifters(1, 2)
    world.claim("A", "r1:0:lift::9")
    assert demand(world).pinned == ()


def test_the_claim_of_a_dead_robot_or_of_an_earlier_life_pins_nobody() -> None:
    world = lifters(1, 2)
    world.claim("A", LIFT)
    world.claim("B", LIFT)
    world.die("A")
    world.join("B", {"lift": 1}, life=2)
    assert demand(world).pinned == ()


# -- Check Consistency ------------------------------------------------------------------------


def feasible(groups: Sequence[Sequence[Demand]], robots: Sequence[str]) -> bool:
    """Whether every lower bound can be met by different robots: by trying everything."""
    slots = [d for group in groups for d in group for _ in range(d.lower)]
    return any(
        all(robot in slot.candidates for robot, slot in zip(chosen, slots, strict=True))
        for chosen in itertools.permutations(robots, len(slots))
    )


def greedy(groups: Sequence[Sequence[Demand]], robots: Sequence[str]) -> list[int]:
    """Requests in tree order, each kept if all kept so far stay feasible together."""
    found: list[int] = []
    for index in range(len(groups)):
        if feasible([groups[i] for i in [*found, index]], robots):
            found.append(index)
    return found


@given(worlds())
def test_requests_are_kept_in_tree_order_as_far_as_all_stay_feasible(world: World) -> None:
    assert kept(world) == (greedy(all_demands(world), sorted(world.alive)), {})


@given(worlds(), st.data())
def test_with_pins_a_request_is_kept_exactly_where_the_free_robots_suffice(
    world: World, data: st.DataObject
) -> None:
    groups = all_demands(world)
    for robot in world.alive:
        able = [d for group in groups for d in group if robot in d.candidates]
        if able and data.draw(st.booleans()):
            chosen = data.draw(st.sampled_from(able))
            world.claim(robot, chosen.request.activation, chosen.local_task)
    found, pinned = kept(world)
    groups = all_demands(world)
    bound = [reduced(group, index, pinned) for index, group in enumerate(groups)]
    free = [robot for robot in world.alive if robot not in pinned]
    assert found == greedy(bound, free)


def reduced(group: Sequence[Demand], index: int, pinned: Mapping[str, int]) -> list[Demand]:
    """What a request still needs beyond the pins that hold."""
    rest = []
    for each in group:
        held = sum(1 for robot in each.pinned if pinned.get(robot) == index)
        lower = max(0, each.lower - held)
        rest.append(
            Demand(each.request, each.local_task, each.needed, lower, lower, (), each.candidates)
        )
    return rest


def two_tasks(
    first: tuple[int, int], second: tuple[int, int], robots: str, **policies: bool
) -> World:
    """Requests `one` and `two`, both lifting; `policies` are those of `one`."""
    tasks = [task("one", ("lift", *first), **policies), task("two", ("lift", *second))]
    team = {name: {"lift": 1} for name in robots}
    return World(make_mission(parallel(2, action("one"), action("two")), team, tasks))


def test_a_running_robot_is_not_taken_away_by_an_earlier_request() -> None:
    world = two_tasks((1, 1), (1, 1), "A")
    world.claim("A", world.activation("two"), "lift")
    assert kept(world) == ([1], {"A": 1})


def test_a_preemptive_request_takes_robots_from_one_further_right() -> None:
    world = two_tasks((1, 1), (1, 1), "A", preemptive=True)
    world.claim("A", world.activation("two"), "lift")
    assert kept(world) == ([0], {})


def test_a_preemptive_request_takes_nobody_from_one_further_left() -> None:
    tasks = [task("one", ("lift", 1, 1)), task("two", ("lift", 1, 1), preemptive=True)]
    tree = parallel(2, action("one"), action("two"))
    world = World(make_mission(tree, {"A": {"lift": 1}}, tasks))
    world.claim("A", world.activation("one"), "lift")
    assert kept(world) == ([0], {"A": 0})


def test_a_preemptive_request_that_cannot_be_served_all_the_same_takes_nobody() -> None:
    world = two_tasks((3, 3), (1, 1), "AB", preemptive=True)
    world.claim("A", world.activation("two"), "lift")
    assert kept(world) == ([1], {"A": 1})


def three_tasks(tree: NodeSpec, robots: dict[str, dict[str, float]], *preemptive: str) -> World:
    """Tasks of one robot each, named after their local task."""
    names = ("one", "two", "three")
    tasks = [task(name, preemptive=name in preemptive) for name in names]
    return World(make_mission(tree, robots, tasks))


def test_a_preemptive_request_takes_only_robots_that_help_it() -> None:
    robots = {"A": {"one": 1.0, "two": 1.0}, "B": {"three": 1.0}}
    tree = parallel(3, action("one"), action("two"), action("three"))
    world = three_tasks(tree, robots, "one")
    world.claim("A", world.activation("two"))
    world.claim("B", world.activation("three"))
    assert kept(world) == ([0, 2], {"B": 2})


def test_a_preempted_robot_may_help_by_stepping_in_for_another() -> None:
    # Only A can do two, which B could take off its hands; B runs three.
    robots = {"A": {"one": 1.0, "two": 1.0}, "B": {"one": 1.0, "three": 1.0}}
    tree = parallel(3, action("one"), action("two"), action("three"))
    world = three_tasks(tree, robots, "two")
    world.claim("B", world.activation("three"))
    assert kept(world) == ([0, 1], {})


def test_a_pin_of_a_request_that_cannot_be_kept_yields_to_one_that_then_can() -> None:
    world = two_tasks((2, 2), (1, 1), "A")
    world.claim("A", world.activation("one"), "lift")
    assert kept(world) == ([1], {})


def test_a_pin_of_a_request_that_cannot_be_kept_yields_to_the_first_one_in_tree_order() -> None:
    # B would be busy with `three` unless A's vain work on `one` ends; `two` needs both.
    tasks = [
        task("one", ("lift", 3, 3)),
        task("two", ("lift", 2, 2)),
        task("three", ("lift", 1, 1)),
    ]
    tree = parallel(3, action("one"), action("two"), action("three"))
    world = World(make_mission(tree, {"A": {"lift": 1}, "B": {"lift": 1}}, tasks))
    world.claim("A", world.activation("one"), "lift")
    assert kept(world) == ([1], {})


def test_of_two_pins_only_the_one_that_helps_yields() -> None:
    tasks = [task("one", ("lift", 3, 3)), task("two", ("look", 1, 1))]
    robots = {"A": {"lift": 1}, "B": {"lift": 1, "look": 1}}
    world = World(make_mission(parallel(2, action("one"), action("two")), robots, tasks))
    for robot in robots:
        world.claim(robot, world.activation("one"), "lift")
    assert kept(world) == ([1], {"A": 0})


def test_a_pin_that_would_help_nobody_goes_on() -> None:
    world = two_tasks((2, 2), (2, 2), "A")
    world.claim("A", world.activation("one"), "lift")
    assert kept(world) == ([], {"A": 0})


def test_a_long_chain_of_robots_that_step_aside_is_no_problem() -> None:
    count = 1_000
    local = [f"l{number}" for number in range(count)]
    robots = {f"r{i:04}": {local[i]: 1.0, local[(i + 1) % count]: 1.0} for i in range(count)}
    tasks = [task(name) for name in local]
    tree = parallel(count, *map(action, [*local[1:], local[0]]))
    world = World(make_mission(tree, robots, tasks))
    assert kept(world)[0] == list(range(count))


# -- blocked ----------------------------------------------------------------------------------


def reasons(world: World) -> list[str]:
    capable = capabilities_of(world.facts, world.alive)
    (group,) = all_demands(world)
    return [str(each) for each in shortages(world.facts, group, capable)]


def test_a_request_is_blocked_when_no_living_robots_could_serve_it() -> None:
    world = lifters(2, 2, "A", "B")
    assert reasons(world) == []
    world.die("A")
    assert reasons(world) == ["lift needs 2, 1 alive"]


def test_robots_that_are_busy_block_nothing() -> None:
    world = two_tasks((1, 1), (1, 1), "A")
    world.claim("A", world.activation("two"), "lift")
    capable = capabilities_of(world.facts, world.alive)
    assert [shortages(world.facts, group, capable) for group in all_demands(world)] == [(), ()]


def test_successes_so_far_are_named() -> None:
    world = lifters(2, 2, "A", "B")
    world.outcome(LIFT, True, "A")
    world.die("B")
    assert reasons(world) == ["lift needs 2, 1 alive, 1 done"]


def test_robots_that_have_failed_are_named_so_that_the_numbers_make_sense() -> None:
    world = lifters(1, 1, "A", "B")
    world.outcome(LIFT, False, "A")
    world.die("B")
    assert reasons(world) == ["lift needs 1, 1 alive, 1 failed"]


def test_needs_that_can_only_be_met_one_by_one_are_all_named() -> None:
    robots = {"A": {"lift": 1, "look": 1}}
    both = task("both", ("lift", 1, 1), ("look", 1, 1))
    world = World(make_mission(action("both"), robots, [both]))
    assert reasons(world) == ["lift needs 1, 1 alive", "look needs 1, 1 alive"]


def test_a_worker_is_a_robot_with_its_description() -> None:
    world = lifters(1, 1, "A")
    assert workers(world.facts, world.alive) == {"A": Worker("A", *world.facts.members["A"])}
