"""Whether the living could finish a mission: by trying out every way in which it may go on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from mrbt_mesh.core.bt.tree import Kind, NodeSpec
from mrbt_mesh.core.mission.mission import FailurePolicy
from mrbt_mesh.features.exclusive.kinds import DOUBT
from mrbt_mesh.sim.checkers.finishing import MAX_EVALUATIONS, can_finish
from tests.support.build import (
    World,
    action,
    condition,
    decorated,
    fallback,
    keep_running,
    make_mission,
    parallel,
    repeat,
    retry,
    sequence,
    task,
    timeout,
)

TEAM = {"R1": {"a": 1.0, "b": 1.0, "c": 1.0}, "R2": {"a": 1.0}, "R3": {"c": 1.0}}


def world_of(tree: NodeSpec, **policies: Any) -> World:
    """R1, R2 and R3; the policies are those of the task `a`."""
    return World(make_mission(tree, TEAM, [task("a", **policies)]))


def finishes(world: World) -> bool:
    """By an agent that rests with these facts and robots."""
    view: Any = SimpleNamespace(facts=world.facts, mission=world.mission, plan=world.plan())
    return can_finish(view, world.alive)


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        (sequence(action("a"), action("b")), True),
        (sequence(action("c"), action("d")), True),  # it fails if `c` does
        (sequence(decorated(Kind.FORCE_SUCCESS, action("c")), action("d")), False),
        (fallback(action("d"), action("a")), False),
        (fallback(action("a"), action("d")), True),
        (parallel(1, action("d"), action("a")), True),
        (parallel(2, action("d"), decorated(Kind.FORCE_SUCCESS, action("a"))), False),
        (timeout(5, action("d")), True),
        (sequence(condition("x"), action("d")), True),
        (retry(2, sequence(action("a"), action("b"))), True),
        (repeat(3, action("a")), True),
        (decorated(Kind.FORCE_SUCCESS, action("d")), False),
        (keep_running(decorated(Kind.FORCE_FAILURE, action("a"))), True),
        (keep_running(decorated(Kind.FORCE_SUCCESS, action("a"))), False),
    ],
)
def test_with_all_robots(tree: NodeSpec, expected: bool) -> None:
    assert finishes(World(make_mission(tree, TEAM))) is expected


def test_what_has_failed_and_cannot_be_made_good_does_fail() -> None:
    for policy in FailurePolicy:
        world = world_of(fallback(action("a"), action("b")), failure=policy)
        world.die("R2")
        world.outcome(world.activation("a"), False, "R1")
        assert finishes(world)


def test_where_nobody_has_failed_it_stays_blocked_unless_it_says_so() -> None:
    for limit_us in (None, 5):
        world = world_of(fallback(action("a"), action("c")), blocked_fail_after_us=limit_us)
        world.die("R1")
        world.die("R2")
        assert finishes(world) is (limit_us is not None)


def test_nothing_is_demanded_of_a_team_that_rests_by_order() -> None:
    world = world_of(action("a"))
    world.order("pause")
    assert not finishes(world)


def test_what_is_exclusive_needs_a_majority_and_no_doubt() -> None:
    world = world_of(action("a"), exclusive=True)
    activation = world.activation("a")
    assert finishes(world)
    world.die("R3")
    assert finishes(world)
    world.die("R2")
    assert not finishes(world)
    doubted = world_of(action("a"), exclusive=True)
    token = doubted.form(activation, "R1")
    doubted.say(DOUBT, activation, token, "R1", "R2", "R3")
    assert not finishes(doubted)


def test_no_more_is_tried_out_than_is_bearable() -> None:
    """Of 2 to the power of 30 ways none is the end, but not all of them are looked at."""
    tree = sequence(
        parallel(30, *[decorated(Kind.FORCE_SUCCESS, action("a")) for _ in range(30)]),
        action("d"),
    )
    assert MAX_EVALUATIONS < 1_000
    assert not finishes(World(make_mission(tree, TEAM)))
