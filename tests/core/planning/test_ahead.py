"""What lies ahead, against what a team asks for that succeeds in everything, round by round."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.evaluation import Request
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


def flat(rounds: Sequence[Sequence[Request]]) -> list[Request]:
    return [each for found in rounds for each in found]


def order(spec: NodeSpec, most: int = MOST) -> dict[str, set[str]]:
    """Subject of each task ahead -> subjects of those before it; of loops only the last one."""
    world = World(spec)
    rounds = tasks_ahead(world.evaluator, world.facts, world.tick(), most)
    ahead, after = flat(rounds), precedence(world.evaluator, rounds)
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
    ahead = flat(tasks_ahead(world.evaluator, world.facts, world.tick(), 5))
    assert [each.subject for each in ahead] == ["a", "b1", "a", "b2", "a"]


@given(tree_specs(), st.randoms())
def test_a_team_that_always_succeeds_asks_for_what_was_foretold(
    spec: NodeSpec, choice: random.Random
) -> None:
    world = World(spec)
    names = {
        each.activation
        for each in flat(tasks_ahead(world.evaluator, world.facts, world.tick(), MOST))
    }
    for _ in range(MOST):
        asked = [each.activation for each in world.tick().requests]
        assert len(names) == MOST or names.issuperset(asked), spec
        if not asked:
            break
        for activation in choice.sample(asked, len(asked)):
            world.outcome(activation, True)


@given(tree_specs(), st.integers(0, MOST))
def test_whatever_holds_a_task_up_comes_before_it(spec: NodeSpec, number: int) -> None:
    """One task never ends, all others succeed: what is not asked for then is after that one."""
    world = World(spec)
    rounds = tasks_ahead(world.evaluator, world.facts, world.tick(), MOST)
    ahead, after = flat(rounds), precedence(world.evaluator, rounds)
    if number >= len(ahead):
        return
    asked, held = set[str](), ahead[number].activation
    for _ in range(3 * MOST):
        requests = [each.activation for each in world.tick().requests]
        asked.update(requests)
        others = [activation for activation in requests if activation != held]
        if not others:
            break
        world.outcome(others[0], True)
    else:
        return  # a loop without a limit goes on
    for each in ahead:
        if each.activation not in asked:
            assert held in after[each.activation], (spec, held, each)
