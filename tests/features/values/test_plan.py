"""Who may be asked where robots have conditions of their own, and what of them is lost."""

from __future__ import annotations

from itertools import product

import pytest

from mrbt_mesh.core.bt.evaluation import OutcomeTick
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import ConditionValue
from mrbt_mesh.core.planning.deadlines import Deadlines
from tests.support.build import World, action, condition, fallback, inverter, sequence
from tests.support.per_robot_conditions import TREE, per_robot_mission

S = 1_000_000
ROBOTS = ("A1", "A2", "B-1")


def world_of(tree: NodeSpec = TREE, holding: str = "") -> World:
    """`holding` holds for these robots."""
    world = World(per_robot_mission(tree))
    for robot in holding.split():
        world.set(f"holding@{robot}", True, robot)
    world.tick()
    return world


def candidates(world: World) -> dict[str, list[str]]:
    """Requested global task -> the robots that may be put on it."""
    return {g[0].request.subject: sorted(g[0].candidates) for g in world.plan().demands}


def test_a_leaf_holds_if_it_holds_for_any_robot() -> None:
    world = world_of()
    assert not world.facts.condition("holding")
    world.set("holding@A2", True, "A2")
    assert world.facts.condition("holding")
    world.set("holding@A1", True, "A1")
    world.set("holding@A2", False, "A2")
    assert world.facts.condition("holding")
    assert world.facts.condition_of("A1", "holding")
    assert not world.facts.condition_of("A2", "holding")
    world.set("holding@A1", False, "A1")
    assert not world.facts.condition("holding")


def test_what_stands_behind_is_for_those_for_which_it_holds() -> None:
    assert candidates(world_of()) == {"pick": list(ROBOTS)}
    assert candidates(world_of(holding="A2")) == {"place": ["A2"]}
    assert candidates(world_of(holding="A2 B-1")) == {"place": ["A2", "B-1"]}


def test_what_holds_for_nobody_asks_for_nothing_where_the_team_goes_on_without_it() -> None:
    world = world_of()
    world.outcome(world.activation("pick"), True, "A1")  # and sets nothing
    assert candidates(world) == {"place": list(ROBOTS)}
    world.set("holding@B-1", True, "B-1")
    world.tick()
    assert candidates(world) == {"place": ["B-1"]}


def test_it_is_picked_again_once_nobody_holds_it_and_not_before() -> None:
    world = world_of(holding="A1 A2")
    first = world.activation("place")
    world.set("holding@A1", False, "A1")
    world.tick()
    assert world.activation("place") == first
    world.set("holding@A2", False, "A2")
    world.tick()
    assert candidates(world) == {"pick": list(ROBOTS)}
    world.set("holding@B-1", True, "B-1")
    world.tick()
    assert world.activation("place") != first


def test_compound_guards_are_as_each_robot_reads_them() -> None:
    """By brute force: for whom the condition holds, and for whom another one does not."""
    both = sequence(condition("holding"), inverter(condition("lid")))
    tree = sequence(fallback(both, action("pick")), action("place"))
    for mine, lid in product(product((False, True), repeat=3), (False, True)):
        world = world_of(tree, " ".join(r for r, own in zip(ROBOTS, mine, strict=True) if own))
        world.set("lid", lid)
        world.tick()
        allowed = [r for r, own in zip(ROBOTS, mine, strict=True) if own and not lid]
        expected = {"place": allowed} if allowed else {"pick": list(ROBOTS)}
        assert candidates(world) == expected


def test_where_nobody_can_do_it_the_plan_says_what_is_lacking() -> None:
    world = world_of(holding="A2")
    world.die("A2")
    (waiting,) = world.plan().waiting
    assert waiting.reason == "blocked: place needs 1 with holding, 0 alive"


def test_in_the_tick_of_an_outcome_its_per_robot_conditions_are_read_after_it() -> None:
    world = world_of(holding="A1")
    place = world.activation("place")
    after = world.facts.conditions.after({"holding@A1": False})
    tick = OutcomeTick(world.facts, place, Status.SUCCESS, after)
    assert world.evaluator.evaluate(tick).status is Status.SUCCESS
    assert not tick.condition("holding"), "what is read after it sees what has been set"


# -- what dead robots had ---------------------------------------------------------------------


@pytest.mark.parametrize("how", ["die", "leave"])
def test_what_a_robot_had_that_is_gone_is_lost_after_a_time(how: str) -> None:
    world = world_of(holding="A1 A2")
    assert world.plan().pending_losses == ()
    getattr(world, how)("A2")
    plan = world.plan()
    assert [(loss.condition, loss.changes) for loss in plan.pending_losses] == [("holding@A2", 2)]
    deadlines = Deadlines(1 * S, 3 * S)
    assert deadlines.expired(plan, world.facts, 0, lambda: True) == []
    assert deadlines.next_deadline_us() == 3 * S
    assert deadlines.expired(plan, world.facts, 3 * S, lambda: False) == []
    assert deadlines.awaits_agreement
    written = deadlines.expired(plan, world.facts, 3 * S, lambda: True)
    assert written == [(f"{records.CONDITION}/holding@A2", ConditionValue(False, 2, 0))]
    world.write("A1", *written)
    world.write("B-1", *written)
    assert world.plan().pending_losses == ()
    assert world.facts.condition("holding")


def test_a_robot_that_is_seen_again_in_time_loses_nothing() -> None:
    world = world_of(holding="A2")
    deadlines, alive = Deadlines(1 * S, 3 * S), dict(world.alive)
    world.die("A2")
    assert deadlines.expired(world.plan(), world.facts, 0, lambda: True) == []
    world.alive = alive
    assert deadlines.expired(world.plan(), world.facts, 2 * S, lambda: True) == []
    world.die("A2")
    assert deadlines.expired(world.plan(), world.facts, 4 * S, lambda: True) == []
    assert deadlines.next_deadline_us() == 7 * S


@pytest.mark.parametrize(
    ("stage", "expected"),
    [
        (fallback(sequence(action("check"), condition("holding")), action("pick")), ["A2"]),
        (
            NodeSpec(
                Kind.FORCE_SUCCESS,
                (fallback(sequence(action("check"), condition("holding")), action("pick")),),
            ),
            list(ROBOTS),
        ),
    ],
    ids=["a Fallback asks for it", "a ForceSuccess asks for nothing"],
)
def test_what_stands_behind_a_condition_that_is_read_after_an_action(
    stage: NodeSpec, expected: list[str]
) -> None:
    world = World(per_robot_mission(sequence(stage, action("place"))))
    world.outcome(world.activation("check"), True, "A1")
    world.set("holding@A2", True, "A2")
    world.tick()
    assert candidates(world) == {"place": expected}
