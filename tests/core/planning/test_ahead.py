"""What lies ahead, against what a team asks for that succeeds in everything, in any order."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import NodeSpec
from mrbt_mesh.core.planning.ahead import precedence, tasks_ahead
from tests.support.build import (
    World,
    action,
    condition,
    fallback,
    keep_running,
    parallel,
    repeat,
    retry,
    sequence,
)
from tests.support.strategies import tree_specs

MOST = 12


def order(spec: NodeSpec, most: int = MOST) -> dict[str, set[str]]:
    """Subject of each task ahead -> subjects of those before it; of loops only the last one."""
    world = World(spec)
    requests = world.tick().requests
    ahead = tasks_ahead(world.evaluator, world.facts, most)
    after = precedence(world.evaluator, world.facts, ahead, len(requests))
    names = {each.activation: each.subject for each in ahead}
    return {
        each.subject: {names[name] for name in after.get(each.activation, ())} for each in ahead
    }


def pair(name: str) -> NodeSpec:
    return sequence(action(f"{name}1"), action(f"{name}2"))


@pytest.mark.parametrize(
    ("spec", "found"),
    [
        (
            parallel(2, pair("a"), pair("b")),
            {"a1": set(), "b1": set(), "a2": {"a1"}, "b2": {"b1"}},
        ),
        (sequence(pair("a"), action("b")), {"a1": set(), "a2": {"a1"}, "b": {"a1", "a2"}}),
        (fallback(action("a"), action("b")), {"a": set()}),
        (fallback(condition("c"), action("b")), {"b": set()}),
        (sequence(condition("c"), action("b")), {}),
        (sequence(retry(3, action("a")), action("b")), {"a": set(), "b": {"a"}}),
        (repeat(3, action("a")), {"a": {"a"}}),
        (repeat(2, parallel(2, action("a"), action("b"))), {"a": {"a", "b"}, "b": {"a", "b"}}),
    ],
)
def test_the_tree_says_what_comes_before_what(spec: NodeSpec, found: dict[str, set[str]]) -> None:
    assert order(spec) == found


def test_a_loop_without_a_limit_is_looked_ahead_for_a_number_of_tasks() -> None:
    world = World(parallel(2, keep_running(action("a")), pair("b")))
    ahead = tasks_ahead(world.evaluator, world.facts, 5)
    assert [each.subject for each in ahead] == ["a", "b1", "a", "b2", "a"]


@given(tree_specs(), st.randoms())
def test_a_team_that_always_succeeds_asks_for_what_was_foretold_and_in_that_order(
    spec: NodeSpec, choice: object
) -> None:
    draw = choice.choice  # type: ignore[attr-defined]
    world = World(spec)
    requests = world.tick().requests
    ahead = tasks_ahead(world.evaluator, world.facts, MOST)
    after = precedence(world.evaluator, world.facts, ahead, len(requests))
    names, done = {each.activation for each in ahead}, set[str]()
    for _ in range(MOST):
        asked = [each.activation for each in world.tick().requests]
        for name in asked:
            if len(names) < MOST:
                assert name in names, (spec, done)
            assert done.issuperset(after.get(name, ())), (spec, done, name)
        if not asked:
            break
        activation = draw(asked)
        world.outcome(activation, True)
        done.add(activation)
