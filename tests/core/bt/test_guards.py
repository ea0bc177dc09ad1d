"""Guards of several conditions that decide together, and what is read before a node is reached."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.guards import Guards
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status, build_tree
from mrbt_mesh.core.facts.records import EXPRESSION
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from tests.support.btcpp.stories import (
    Grower,
    Story,
    has_place_for_until_success,
    labelled,
    our_run,
    reference_run,
)
from tests.support.build import (
    World,
    action,
    condition,
    fallback,
    inverter,
    parallel,
    refusal,
    sequence,
)
from tests.support.mutations import MUTATIONS
from tests.support.reticked import first_difference, random_tree

A, B, CLOSE, USE = map(action, ("a", "b", "close", "use"))
C1, C2 = condition("c1"), condition("c2")
LID, LOCKED = condition("lid"), condition("locked")
VERSION = Version(Incarnation(1, "n"), 1)
THE_LID = sequence(fallback(sequence(LID, LOCKED), CLOSE), USE)


# -- golden cases -----------------------------------------------------------------------------


def test_golden_case_4_a_lid_that_opens_is_closed_again_and_again() -> None:
    world = World(THE_LID, true_at_first=["lid"])
    for _ in range(3):
        assert world.asked() == ["close"]
        world.succeed("close")
        world.set("locked", True)
        assert world.asked() == ["use"]
        before = world.activation("use")
        world.set("locked", False)
        assert world.asked() == ["close"], "the lid is open"
        world.set("locked", True)
        assert world.activation("use") != before, "what was begun with an open lid is begun anew"
        world.set("locked", False)
    world.succeed("close")
    world.set("locked", True)
    world.succeed("use")
    assert world.status is Status.SUCCESS


def test_golden_case_5_a_second_breakdown_is_repaired() -> None:
    world = World(fallback(sequence(C1, C2), A))
    world.succeed("a")
    assert world.status is Status.SUCCESS
    for name in ("c1", "c2"):
        world.set(name, True)
    world.tick()
    world.set("c2", False)
    assert world.asked() == ["a"]


def test_golden_case_6_a_guard_that_never_failed_repeats_nothing() -> None:
    world = World(sequence(parallel(1, C1, C2), A, B), true_at_first=["c1", "c2"])
    world.succeed("a")
    before = world.activation("b")
    world.set("c2", False)
    assert world.asked() == ["b"]
    assert world.activation("b") == before
    world.set("c1", False)
    world.set("c2", True)
    assert world.activation("b") == before, "in no tick both were false"
    world.set("c2", False)
    assert world.status is Status.FAILURE
    world.set("c1", True)
    assert world.asked() == ["a"], "what the guard has stopped begins anew"


def test_conditions_that_change_in_one_step_turn_a_guard_once_or_not_at_all() -> None:
    world = World(sequence(fallback(C1, C2), A), true_at_first=["c1"])
    before = world.activation("a")
    world.set("c1", False)
    world.set("c2", True)
    assert world.activation("a") == before


# -- what is read -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spec", "subject", "expected"),
    [
        (sequence(sequence(C1, C2), A), "a", (("c1", False), ("c2", False))),
        (sequence(fallback(C1, C2), A), "a", (("#1", False),)),
        (fallback(sequence(C1, C2), A), "a", (("#1", True),)),
        (fallback(fallback(C1, C2), A), "a", (("c1", True), ("c2", True))),
        (sequence(inverter(fallback(C1, C2)), A), "a", (("c1", True), ("c2", True))),
        (sequence(inverter(sequence(C1, C2)), A), "a", (("#2", True),)),
        (sequence(parallel(2, C1, C2), A), "a", (("c1", False), ("c2", False))),
        (sequence(parallel(1, C1, C2), A), "a", (("#1", False),)),
        (sequence(NodeSpec(Kind.FORCE_SUCCESS, (C1,)), A), "a", ()),
        (sequence(fallback(C1, C2, A), B), "b", (("#1:2", False),)),
        (sequence(fallback(C1, A, C2), B), "b", (("#1:success", True),)),
        (sequence(fallback(sequence(A, C1), CLOSE), B), "b", (("#1:success", True),)),
        (sequence(fallback(sequence(A, C1), CLOSE), B), "close", (("#2:failure", True),)),
        (THE_LID, "use", (("#2", False),)),
        (THE_LID, "close", (("#2", True),)),
        (sequence(parallel(1, C1, A), B), "b", (("#1:success", True),)),
    ],
)
def test_guards(spec: NodeSpec, subject: str, expected: tuple[tuple[str, bool], ...]) -> None:
    tree = build_tree(spec)
    (node,) = (each.index for each in tree.actions() if each.subject == subject)
    found = Guards(tree)
    assert found.guards_of[node] == expected
    named = {name for guards in found.guards_of for name, _ in guards if name.startswith("#")}
    assert found.expressions.keys() | found.with_actions.keys() == named


def test_conditions_have_no_guards() -> None:
    """So what is kept of one Sequence grows no faster than its conditions."""
    names = [f"c{number}" for number in range(500)]
    conditions = [NodeSpec(Kind.CONDITION, subject=name) for name in names]
    found = Guards(build_tree(sequence(*conditions, A))).guards_of
    assert found[-1] == tuple((name, False) for name in names)
    assert not any(found[:-1])


def test_an_expression_names_what_it_reads() -> None:
    spec = sequence(fallback(C2, inverter(C1), C2, A), B)
    (found,) = Guards(build_tree(spec)).expressions.values()
    assert found.conditions == ("c1", "c2")
    assert found.spec == fallback(C2, inverter(C1), C2)


# -- replicas ---------------------------------------------------------------------------------


def test_who_hears_only_the_end_of_it_learns_that_the_guard_has_turned() -> None:
    world = World(sequence(fallback(C1, C2), A), true_at_first=["c1"])
    before = world.activation("a")
    for value in (False, True):
        world.set("c1", value)
        world.tick()
    late = World(world.mission)
    late.facts.map.merge(world.facts.map)
    assert late.activation("a") == world.activation("a") != before


def test_late_news_is_no_change() -> None:
    """The word that a guard has turned may come before the conditions that have turned it."""
    world = World(sequence(fallback(C1, C2), A), true_at_first=["c1"])
    for value in (False, True, False):
        world.set("c1", value)
        world.tick()
    *conditions, noted = (e for e in world.entries if e.parts[0] in ("condition", EXPRESSION))
    late = World(world.mission)
    late.facts.map.merge([noted])
    late.tick()
    assert late.facts.conditions.unnoted() == []
    assert late.facts.conditions.noted("#1").changes == 0
    late.facts.map.merge(conditions)
    late.tick()
    assert late.facts.conditions.noted("#1") == world.facts.conditions.noted("#1")


def test_robots_that_see_different_conditions_turn_it_come_to_one_count() -> None:
    world = World(sequence(fallback(C1, C2), A), true_at_first=["c1"])
    world.set("c1", False)
    one, other = world.replayed(world.entries), world.replayed(world.entries)
    one.tick()
    other.set("c2", True, "R2")
    other.tick()
    both = (*one.entries, *other.entries, *world.entries)
    found = {
        robot: replica.replayed(order)
        for robot, replica, order in (("R1", one, both), ("R2", other, both[::-1]))
    }
    activations = {replica.activation("a") for replica in found.values()}
    assert len(activations) == 1


@given(st.lists(st.tuples(st.sampled_from(("c1", "c2", "c3")), st.booleans()), max_size=12))
def test_the_count_is_that_of_whoever_saw_everything(steps: list[tuple[str, bool]]) -> None:
    """Held against counting by hand, and the same from the entries in the opposite order."""
    spec = sequence(fallback(sequence(C1, C2), inverter(condition("c3"))), A)
    world, holds, values = World(spec), True, dict.fromkeys(("c1", "c2", "c3"), False)
    turned = 0
    for name, value in steps:
        world.set(name, value)
        world.tick()
        values[name] = value
        now = (values["c1"] and values["c2"]) or not values["c3"]
        turned += holds and not now
        holds = now
    assert world.facts.turns("#1", False) == turned
    other = world.replayed(reversed(world.entries))
    other.tick()
    assert other.facts.turns("#1", False) == turned


# -- what is accepted -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("#1", [1, [1, 0]], None),
        ("#0", [1, [1, 0]], "not a guard"),
        ("#1:2", [1, [1, 0]], "not a guard"),
        ("#1", [1, [0, 1]], "disagree"),
        ("#1", [2, [1, 0]], "does not follow"),
        ("#1", [1, [1]], "does not follow"),
        ("#1", [1, [1, 0, 0]], "does not follow"),
    ],
)
def test_nobody_can_say_what_does_not_follow(
    name: str, value: list[object], reason: str | None
) -> None:
    world = World(sequence(fallback(C1, C2), A), true_at_first=["c1"])
    found = refusal(world.facts, parse_entry("R1", f"{EXPRESSION}/{name}", VERSION, value))
    assert found is None if reason is None else reason in str(found)


@pytest.mark.parametrize("value", [1, [1], [0, [1]], [1, 1], [1, [-1]], [True, [1]], [1, ["1"]]])
def test_malformed_ones_are_refused(value: object) -> None:
    with pytest.raises(ValueError, match="expected"):
        parse_entry("R1", f"{EXPRESSION}/#1", VERSION, value)


# -- against a tree that is ticked again and again ---------------------------------------------


def test_what_is_behind_an_action_is_renewed_where_the_tree_has_stopped_asking_for_it() -> None:
    """While `use` works the lid closes by itself, then opens: it is closed anew, and used anew."""
    world = World(sequence(fallback(sequence(A, LID), CLOSE), USE))
    world.succeed("a")
    close = world.activation("close")
    world.succeed("close")
    use = world.activation("use")
    world.set("lid", True)
    world.tick()
    assert world.activation("use") == use, "the tree has asked for it throughout"
    world.set("lid", False)
    assert world.asked() == ["close"]
    assert world.activation("close") != close
    world.succeed("close")
    assert world.activation("use") != use


def test_where_the_action_has_failed_what_is_behind_it_decides_nothing() -> None:
    world = World(sequence(fallback(sequence(A, LID), CLOSE), USE))
    world.fail("a")
    world.succeed("close")
    use = world.activation("use")
    for value in (True, False):
        world.set("lid", value)
        assert world.asked() == ["use"]
        assert world.activation("use") == use


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 1_200, 300))
def test_random_trees_do_what_a_tree_does_that_is_ticked_again_and_again(first: int) -> None:
    for seed in range(first, first + 300):
        source = random.Random(seed)
        tree = random_tree(source)
        assert not first_difference(tree, source), labelled(tree)


# -- deliberate bugs --------------------------------------------------------------------------


def test_guards_that_are_counted_one_by_one_are_caught() -> None:
    """By the executor of BehaviorTree.CPP trees."""
    with MUTATIONS["guards_are_counted_one_by_one"]():
        stories = [(Grower(random.Random(f"tree/{n}")).tree(), Story(n)) for n in range(500)]
        found = [
            our_run(spec, story) != reference_run(spec, story)
            for spec, story in stories
            if has_place_for_until_success(spec)
        ]
    assert sum(found) >= 3
