"""The tick in which an action returns, held against the executor of BehaviorTree.CPP trees."""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import replace
from unittest import mock

import pytest

from mrbt_mesh.core.bt.evaluation import OutcomeTick
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status
from tests.support.btcpp.stories import (
    Grower,
    Story,
    has_place_for_until_success,
    labelled,
    our_run,
    reference_run,
)
from tests.support.build import World, action, condition, fallback, sequence
from tests.support.effort import seeds

HOLDING = condition("holding")
PICK_AND_PLACE = sequence(fallback(HOLDING, action("pick")), action("place"))


def test_what_stands_left_of_an_action_has_read_its_conditions_before() -> None:
    world = World(PICK_AND_PLACE, true_at_first=["holding"])
    assert world.returns(world.activation("place"), True, {"holding": False}) is Status.SUCCESS


def test_what_stands_right_of_it_reads_them_afterwards() -> None:
    world = World(sequence(action("diagnose"), condition("broken"), action("fix")))
    assert world.returns(world.activation("diagnose"), True, {"broken": True}) is Status.RUNNING
    world.set("broken", True)
    assert world.asked() == ["fix"]


def test_only_the_action_itself_divides_the_tick() -> None:
    world = World(sequence(fallback(HOLDING, action("pick")), action("place")))
    pick = world.activation("pick")
    tick = OutcomeTick(world.facts, pick, Status.SUCCESS, {"holding": True})
    assert not tick.condition("holding")
    tick.task_status("place", "r1:3:place::0")
    assert not tick.condition("holding")
    assert tick.task_status("pick", pick) is Status.SUCCESS
    assert tick.condition("holding")
    assert not world.facts.condition("holding")


def one_by_one(spec: NodeSpec) -> NodeSpec:
    """The tree with other controls in the place of its Parallels."""
    children = tuple(map(one_by_one, spec.children))
    if spec.kind is not Kind.PARALLEL:
        return replace(spec, children=children)
    kind = Kind.SEQUENCE if spec.limit > 1 else Kind.FALLBACK
    return NodeSpec(kind, children, memory=spec.memory)


def story_differs(seed: int) -> bool | None:
    """Whether it matters when conditions are read; None: there is nothing to compare.

    Trees without Parallels: of several actions that end in one tick either may be the first.
    """
    spec = one_by_one(Grower(random.Random(f"tick/{seed}")).tree(depth=6))
    if not has_place_for_until_success(spec):
        return None
    story = Story(seed, actions_set=True)
    expected, found = reference_run(spec, story), our_run(spec, story)
    assert found == expected, f"seed {seed}\n{labelled(spec)}\n{story.values}"
    return found != our_run(spec, Story(seed))


def test_actions_that_set_conditions_do_what_they_do_in_behaviortree_cpp() -> None:
    """And in some stories it matters when they are read."""
    tried = seeds(1_000)
    counts = Counter(map(story_differs, tried))
    assert counts[True] >= len(tried) // 20


@pytest.mark.parametrize("reads_before", [True, False])
def test_a_tick_that_reads_all_conditions_alike_is_caught(reads_before: bool) -> None:
    """As they were before the action, or as they are after it."""

    def condition(self: OutcomeTick, name: str) -> bool:
        before = self.beneath.condition(name)
        return before if reads_before else self.conditions.get(name, before)

    with mock.patch.object(OutcomeTick, "condition", condition), pytest.raises(AssertionError):
        Counter(story_differs(seed) for seed in range(1_000))


def test_with_memory_the_tick_is_kept() -> None:
    spec: NodeSpec = sequence(fallback(HOLDING, action("pick")), action("place"), action("wave"))
    world = World(spec, true_at_first=["holding"])
    world.returns(world.activation("place"), True, {"holding": False})
    world.set("holding", False)
    assert world.asked() == ["pick"], "a reactive node reads the condition as it is now"
