"""Bids: who is waited for, what counts, and that everybody comes to the same exact optimum."""

from __future__ import annotations

import itertools
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import NodeSpec, Status
from mrbt_mesh.core.facts.records import LATCH
from mrbt_mesh.core.facts.store import Version, parse_entry
from mrbt_mesh.core.mission.mission import (
    MAX_PERFORMANCE,
    MICRO,
    FailurePolicy,
)
from mrbt_mesh.core.planning.deadlines import Deadlines
from mrbt_mesh.features.bids.facts import NO_BIDS, bids_of
from mrbt_mesh.features.bids.plan import LAST_RESORT, Bidding, biddings
from mrbt_mesh.features.exclusive.kinds import BROKEN
from tests.support.build import (
    World,
    action,
    make_mission,
    parallel,
    refusal,
    retry,
    sequence,
    task,
)

DRIVE = ("drive", 1, 1, True)


def town(robots: str = "ABC", *others: str, needs: Any = DRIVE, **policies: Any) -> World:
    """`fetch` needs a robot that drives there, by bid; the `others` stand further right."""
    tasks = [task("fetch", needs, **policies), *(task(name, ("look", 1, 1)) for name in others)]
    tree = parallel(1 + len(others), action("fetch"), *map(action, others))
    return World(make_mission(tree, {r: {"drive": 1, "look": 1} for r in robots}, tasks))


def bid_all(world: World, **bids: float | None) -> None:
    for robot, value in bids.items():
        world.bid(robot, world.activation("fetch"), "drive", value)


def who(world: World) -> dict[str, str]:
    return {robot: line.global_task for robot, line in world.plan().assignments.items()}


def reasons(world: World) -> list[str]:
    return [waiting.reason for waiting in world.plan().waiting]


def bidding(world: World) -> Bidding:
    (found,) = biddings(world.plan())
    return found


# -- who is waited for ------------------------------------------------------------------------


def test_nobody_goes_before_all_have_bid_and_then_the_best_does() -> None:
    world = town()
    assert who(world) == {}
    assert reasons(world) == ["waiting for bids of A, B, C"]
    assert set(world.idle().values()) == {"fetch: waits for bids"}
    bid_all(world, A=-7, C=-4)
    assert who(world) == {}
    assert reasons(world) == ["waiting for bids of B"]
    bid_all(world, B=-5)
    assert who(world) == {"C": "fetch"}
    assert world.plan().assignments["C"].performance == -4 * MICRO
    assert not world.plan().waiting


def test_who_is_dead_leaves_or_cannot_is_not_waited_for() -> None:
    world = town("ABCDE")
    bid_all(world, A=-7)
    world.die("B")
    world.leave("C")
    world.lose("D", "drive")
    assert reasons(world) == ["waiting for bids of E"]
    world.outcome(world.activation("fetch"), False, "E", "drive")
    assert who(world) == {"A": "fetch"}


def test_a_long_list_is_cut_short() -> None:
    world = town("ABCDEF")
    assert reasons(world) == ["waiting for bids of A, B, C and 3 more"]
    bid_all(world, A=1, B=2)
    assert reasons(world) == ["waiting for bids of C, D, E, F"]


def test_without_a_bid_in_time_a_robot_is_the_last_to_be_chosen() -> None:
    world = town()
    bid_all(world, A=-900_000, B=None)
    assert bidding(world).is_open
    world.close(world.activation("fetch"), "drive", "A")
    assert who(world) == {"A": "fetch"}
    assert bidding(world).silent == ("C",)
    bid_all(world, C=-3)  # it is late, but counts from now on
    assert who(world) == {"C": "fetch"}


def test_robots_without_bids_serve_where_nobody_else_can() -> None:
    world = town("AB", needs=("drive", 2, 2, True))
    bid_all(world, A=None)
    world.close(world.activation("fetch"), "drive", "A")
    assert who(world) == {"A": "fetch", "B": "fetch"}
    assert {line.performance for line in world.plan().assignments.values()} == {LAST_RESORT}
    world = town("AB", needs=("drive", 1, 2, True))
    bid_all(world, A=-5, B=None)
    assert who(world) == {"A": "fetch"}, "no more of them than have to"


def test_once_somebody_is_at_it_nobody_is_waited_for() -> None:
    world = town("ABC")
    world.die("C")
    bid_all(world, A=-7, B=-9)
    activation = world.activation("fetch")
    world.claim("A", activation, "drive")
    world.join("C", world.mission.robots["C"].capabilities, life=2)
    assert who(world) == {"A": "fetch"}
    assert (bidding(world).silent, bidding(world).is_open) == ((), False), "one is enough"
    world.claim("B", activation, "drive")
    world.outcome(activation, False, "A", "drive")
    world.die("B")
    assert (bidding(world).silent, bidding(world).is_open) == (("C",), False)
    assert who(world) == {"C": "fetch"}
    world = town("AB", needs=("drive", 1, 2, True))
    world.claim("A", world.activation("fetch"), "drive")
    assert (bidding(world).silent, bidding(world).is_open) == (("A", "B"), False)
    bid_all(world, B=3)
    assert who(world) == {"A": "fetch", "B": "fetch"}, "what is still open it may have"


def test_a_newcomer_is_waited_for_while_nobody_is_at_it() -> None:
    world = town("AB")
    world.die("B")
    bid_all(world, A=-7)
    assert who(world) == {"A": "fetch"}
    world.claim("A", world.activation("fetch"), "drive", running=False)
    world.join("B", world.mission.robots["B"].capabilities, life=2)
    assert reasons(world) == ["waiting for bids of B"]


def test_a_claim_of_an_earlier_life_ends_no_bidding() -> None:
    world = town("AB")
    bid_all(world, B=-7)
    world.ready("A", world.activation("fetch"), "drive")
    assert not bidding(world).is_open
    world.join("A", world.mission.robots["A"].capabilities, life=2)
    assert bidding(world).is_open


# -- the others meanwhile ---------------------------------------------------------------------


def test_what_stands_further_right_takes_no_robot_that_a_waiting_request_could_have() -> None:
    world = town("AB", "see")
    assert who(world) == {}
    assert reasons(world) == ["waiting for bids of A, B"] * 2
    bid_all(world, A=-9, B=-2)
    assert who(world) == {"B": "fetch", "A": "see"}


def test_what_others_run_already_goes_on() -> None:
    world = town("AB", "see")
    world.claim("A", world.activation("see"), "look", running=False)
    assert who(world) == {}, "a claim is given up, as for any better plan"
    world.claim("A", world.activation("see"), "look")
    assert who(world) == {"A": "see"}
    bid_all(world, A=5, B=-2)
    assert who(world) == {"A": "see", "B": "fetch"}


def test_as_many_robots_as_it_needs_are_kept_free() -> None:
    """Even where the robot that is left would rather be elsewhere, and has claimed that."""
    world = town("A", "see")
    world.claim("A", world.activation("see"), "look", running=False)
    assert who(world) == {}
    assert reasons(world)[0] == "waiting for bids of A"


def test_what_stands_further_left_waits_for_nothing() -> None:
    tasks = [task("see", ("look", 1, 1)), task("fetch", DRIVE)]
    tree = sequence(parallel(2, action("see"), action("fetch")))
    team = {"A": {"drive": 1, "look": 1}, "B": {"drive": 1, "look": 2}}
    world = World(make_mission(tree, team, tasks))
    assert who(world) == {"B": "see"}, "which robots it keeps free is all the same to the other"
    bid_all(world, A=-1, B=9)
    assert who(world) == {"A": "see", "B": "fetch"}


def test_robots_that_a_waiting_request_could_not_have_go_elsewhere() -> None:
    tasks = [task("fetch", DRIVE), task("see", ("look", 1, 1))]
    tree = parallel(2, action("fetch"), action("see"))
    world = World(make_mission(tree, {"A": {"drive": 1}, "B": {"look": 1}}, tasks))
    assert who(world) == {"B": "see"}


def test_a_request_that_cannot_be_kept_holds_nobody_back() -> None:
    world = town("AB", "see", needs=("drive", 3, 3, True))
    assert len(who(world)) == 1
    assert reasons(world) == ["blocked: drive needs 3, 2 alive"]
    assert bidding(world).is_open, "it may be served when a third one comes"


# -- with the other policies ------------------------------------------------------------------


@pytest.mark.parametrize("policies", [{"simultaneous": True}, {"exclusive": True}])
def test_coalitions_are_formed_of_the_best_bids(policies: dict[str, bool]) -> None:
    world = town("ABC", needs=("drive", 2, 2, True), **policies)
    activation = world.activation("fetch")
    bid_all(world, A=-7, B=-1)
    assert who(world) == {}
    bid_all(world, C=-2)
    assert who(world) == {"B": "fetch", "C": "fetch"}
    assert {line.leader for line in world.plan().assignments.values()} == {"B"}
    token = world.form(activation, "B", "C")
    world.die("A")
    world.join("A", world.mission.robots["A"].capabilities, life=2)
    assert who(world) == {"B": "fetch", "C": "fetch"}
    world.say(BROKEN, activation, token, "B")
    assert not bidding(world).is_open, "bids stand as long as their activation"


def test_a_failure_by_the_papers_policy_counts_as_without_bids() -> None:
    world = town("AB", failure=FailurePolicy.PAPER)
    bid_all(world, A=-1, B=-2)
    world.claim("A", world.activation("fetch"), "drive")
    world.outcome(world.activation("fetch"), False, "A", "drive")
    assert world.status is Status.FAILURE


def test_a_declared_need_beside_one_by_bid_waits_with_it() -> None:
    tasks = [task("fetch", DRIVE, ("lift", 1, 1))]
    world = World(make_mission(action("fetch"), {"A": {"drive": 1}, "B": {"lift": 2}}, tasks))
    assert who(world) == {}
    bid_all(world, A=-3)
    assert {r: line.performance for r, line in world.plan().assignments.items()} == {
        "A": -3 * MICRO,
        "B": 2 * MICRO,
    }


# -- the optimum ------------------------------------------------------------------------------

values = st.integers(-3, 3)


def places(count: int) -> NodeSpec:
    return parallel(count, *(action(f"go({i})") for i in range(count)))


@given(st.data())
def test_the_sum_of_the_bids_is_the_greatest_there_is(data: st.DataObject) -> None:
    robots = [f"r{i}" for i in range(data.draw(st.integers(1, 4)))]
    count = data.draw(st.integers(1, len(robots)))
    tasks = [task(f"go({i})", (f"drive({i})", 1, 2, True)) for i in range(count)]
    world = World(make_mission(places(count), {r: {"drive": 1} for r in robots}, tasks))
    activations = [world.activation(each.id) for each in tasks]
    bids = {(r, i): data.draw(values) for r in robots for i in range(count)}
    order = data.draw(st.permutations(sorted(bids)))
    for robot, i in order:
        assert not world.plan().assignments or all(
            x.global_task != f"go({i})" for x in world.plan().assignments.values()
        )
        world.bid(robot, activations[i], f"drive({i})", bids[robot, i])
    plan = world.plan()
    total = sum(bids[r, int(line.local_task[6:-1])] for r, line in plan.assignments.items())
    best = max(
        sum(bids[r, i] for r, i in zip(robots, choice, strict=True) if i < count)
        for choice in itertools.product(range(count + 1), repeat=len(robots))
        if all(1 <= choice.count(i) <= 2 for i in range(count))
    )
    assert total == best


# -- as facts ---------------------------------------------------------------------------------


@given(st.randoms(use_true_random=False))
def test_replicas_plan_the_same_whatever_the_order_of_arrival(pick: random.Random) -> None:
    world = town("ABC", "see")
    bid_all(world, A=-7, B=None, C=-7)
    world.close(world.activation("fetch"), "drive", "A")
    entries = list(world.entries)
    pick.shuffle(entries)
    assert world.replayed(entries).plan().packed == world.plan().packed


def test_the_first_bid_stands() -> None:
    world = town("A")
    bid_all(world, A=-7)
    bid_all(world, A=-1)
    assert world.plan().assignments["A"].performance == -7 * MICRO


def test_bids_are_dropped_with_their_activation() -> None:
    tasks = [task("fetch", DRIVE)]
    world = World(make_mission(retry(2, action("fetch")), {"A": {"drive": 1}}, tasks))
    first = world.activation("fetch")
    bid_all(world, A=-7)
    world.close(first, "drive", "A")
    world.outcome(first, False, "A", "drive")
    world.tick()
    world.facts.prune()
    assert world.activation("fetch") != first
    assert not any(entry.name.startswith(("bid/", "closed/")) for entry in world.facts.map)
    assert bids_of(world.facts, first) is NO_BIDS
    assert reasons(world) == ["waiting for bids of A"]


@pytest.mark.parametrize("value", [True, 1.5, "3", [1], MAX_PERFORMANCE + 1, -MAX_PERFORMANCE - 1])
def test_a_bid_is_an_integer_in_range_or_none(value: Any) -> None:
    world = town("A")
    name = f"bid/{world.activation('fetch')}/drive"
    with pytest.raises(ValueError, match="expected, found"):
        parse_entry("A", name, Version(world.alive["A"], 9), value)


def test_bids_for_what_is_not_by_bid_are_refused() -> None:
    world = town("A", "see")
    version = Version(world.alive["A"], 9)
    for subject, local_task in (("see", "look"), ("fetch", "look"), ("fetch", "swim")):
        for kind, value in (("bid", 1), ("closed", True)):
            name = f"{kind}/{world.activation(subject)}/{local_task}"
            reason = refusal(world.facts, parse_entry("A", name, version, value))
            assert reason == f"{subject!r}: {local_task!r} is not for bids"


def test_whoever_sees_the_time_pass_says_so() -> None:
    world = town("A", needs=("drive", 1, 1, True, 700_000))
    usual, name = town("A"), f"closed/{world.activation('fetch')}/drive"
    for each, limit_us in ((world, 700_000), (usual, 300_000)):
        watches = Deadlines(1_000_000, 1_000_000)
        assert watches.expired(each.plan(), each.facts, 50, lambda: True) == []
        assert watches.next_deadline_us() == limit_us + 50
        assert watches.expired(each.plan(), each.facts, limit_us + 49, lambda: True) == []
        assert watches.expired(each.plan(), each.facts, limit_us + 50, lambda: True) == [
            (name, LATCH)
        ]
        bid_all(each, A=3)
        assert watches.expired(each.plan(), each.facts, limit_us + 50, lambda: True) == []


def test_the_plan_as_data_says_who_bid_what() -> None:
    world = town()
    bid_all(world, A=-1.5, B=None)
    (row,) = world.plan().to_json()["bids"]
    assert row == {
        "activation": world.activation("fetch"),
        "global_task": "fetch",
        "local_task": "drive",
        "bids": {"A": -1.5, "B": None},
        "silent": ["C"],
        "open": True,
    }
