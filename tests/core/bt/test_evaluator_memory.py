"""Nodes with memory and reactive ones, held against BehaviorTree.CPP's documented rules.

`tests.support.btcpp.stories` says how.
"""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.core.bt.tree import Status as Ours
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from tests.support.btcpp.stories import (
    Grower,
    Story,
    has_place_for_until_success,
    labelled,
    our_run,
    reference_run,
)
from tests.support.build import RUN, World, action, condition, refusal
from tests.support.effort import seeds

VERSION = Version(Incarnation(1, "n"), 1)
REMEMBERS = Memory.WHILE_RUNNING


def test_random_trees_run_as_in_behaviortree_cpp() -> None:
    """Of which enough have something to remember."""
    remembered = 0
    for seed in seeds(1_000):
        spec = Grower(random.Random(f"tree/{seed}")).tree()
        if has_place_for_until_success(spec):
            story = Story(seed)
            found = our_run(spec, story)
            assert found == reference_run(spec, story), f"seed {seed}\n{labelled(spec)}"
            remembered += found != our_run(forgetful(spec), story)
    assert remembered >= len(seeds(1_000)) // 20


def forgetful(spec: NodeSpec) -> NodeSpec:
    """The same tree without any memory."""
    children = tuple(forgetful(child) for child in spec.children)
    return replace(spec, children=children, memory=Memory.NONE)


# -- single cases -----------------------------------------------------------------------------


def sequence(*children: NodeSpec, memory: Memory = REMEMBERS) -> NodeSpec:
    return NodeSpec(Kind.SEQUENCE, children, memory=memory)


def test_a_replica_that_never_saw_the_condition_true_goes_on_as_well() -> None:
    world = World(sequence(condition("c"), action("a")), true_at_first=("c",))
    world.tick()
    world.set("c", False)
    late = world.replayed(reversed(world.entries))
    assert late.asked() == ["a"]


def test_a_guard_above_makes_it_forget() -> None:
    inner = sequence(condition("c"), action("a"))
    world = World(NodeSpec(Kind.SEQUENCE, (condition("on"), inner)), true_at_first=("c", "on"))
    before = world.activation("a")
    world.set("on", False)
    world.set("c", False)
    world.set("on", True)
    assert world.status is Ours.FAILURE, "it begins anew, and reads c again"
    world.set("c", True)
    assert world.activation("a") != before


def test_until_success_a_retry_goes_on_where_it_failed() -> None:
    inner = sequence(action("a"), action("b"), action("d"), memory=Memory.UNTIL_SUCCESS)
    world = World(NodeSpec(Kind.RETRY, (inner,), limit=3))
    world.succeed("a")
    world.fail("b")
    assert world.asked() == ["b"]
    world.succeed("b")
    world.fail("d")
    assert world.asked() == ["d"]
    world.succeed("d")
    assert world.status is Ours.SUCCESS


@pytest.mark.parametrize(("limit", "status"), [(-1, Ours.RUNNING), (3, Ours.FAILURE)])
def test_what_an_earlier_attempt_has_done_uses_up_no_other_one(limit: int, status: Ours) -> None:
    inner = sequence(action("a"), condition("c"), memory=Memory.UNTIL_SUCCESS)
    world = World(NodeSpec(Kind.RETRY, (inner,), limit=limit))
    world.succeed("a")
    assert world.status is status
    assert world.asked() == []
    world.set("c", True)
    assert world.status is Ours.SUCCESS


def test_what_has_passed_is_dropped_once_it_is_out_of_reach() -> None:
    inner = sequence(condition("c"), action("a"))
    world = World(NodeSpec(Kind.SEQUENCE, (condition("on"), inner)), true_at_first=("c", "on"))
    world.tick()
    names = [entry.name for entry in world.facts.map if entry.name.startswith("passed/")]
    assert len(names) == 1
    world.set("on", False)
    world.facts.prune()
    assert not any(entry.name.startswith("passed/") for entry in world.facts.map)


@pytest.mark.parametrize("position", ["1", "-1", "x", "00"])
def test_nobody_can_say_what_no_node_remembers(position: str) -> None:
    world = World(sequence(action("a"), memory=Memory.NONE))
    entry = parse_entry("R1", f"passed/{RUN}:0::: 0/{position}".replace(" ", ""), VERSION, True)
    assert "to remember" in str(refusal(world.facts, entry))
    world = World(sequence(action("a")))
    assert "to remember" in str(refusal(world.facts, entry))
