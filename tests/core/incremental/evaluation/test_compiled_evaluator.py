"""The compiled evaluator held against the definition."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.activation import ActivationNames
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec, build_tree
from mrbt_mesh.core.incremental.evaluation.compiled_evaluator import CompiledEvaluator
from mrbt_mesh.core.incremental.evaluation.compiled_tree import CompiledTree
from mrbt_mesh.core.incremental.evaluation.turn_sums import TurnSums
from tests.support.build import World, action, condition, sequence
from tests.support.strategies import STEPS, Run, tree_specs


@given(tree_specs(max_leaves=16), STEPS)
def test_every_step_of_a_run_is_evaluated_as_the_rules_say(
    spec: NodeSpec, steps: list[tuple[int, bool]]
) -> None:
    run = Run(spec)
    world = run.world
    compiled = CompiledEvaluator(world.mission.tree)
    assert world.evaluator.evaluate(world.facts) == compiled.evaluate(world.facts)
    for choice, success in steps:
        run.happen(choice, success)
        # Before what follows is written down as well as after.
        assert world.evaluator.evaluate(world.facts) == compiled.evaluate(world.facts)
        run.note()
        assert world.evaluator.evaluate(world.facts) == compiled.evaluate(world.facts)


@given(tree_specs(max_leaves=16), st.lists(st.tuples(st.integers(0, 99), st.integers(0, 5))))
def test_the_guards_of_a_node_are_those_of_the_rules(
    spec: NodeSpec, turns: list[tuple[int, int]]
) -> None:
    tree = build_tree(spec)
    plain = ActivationNames(tree)
    layout = CompiledTree(plain)
    sums = TurnSums(layout)
    for guard, number in turns:
        if layout.guards:
            sums.set(guard % len(layout.guards), number)
    counts = dict(zip(layout.guards, sums.turned, strict=True))
    for node in range(len(tree.nodes)):
        found = sorted(layout.guards[number] for number in layout.guards_at(node))
        assert found == sorted(plain.guards_of[node])
        assert sums.at(node) == sum(counts[guard] for guard in found)


@given(tree_specs(max_leaves=16))
def test_every_subtree_takes_neighbouring_ranks_its_root_the_last(spec: NodeSpec) -> None:
    layout = CompiledTree(ActivationNames(build_tree(spec)))
    assert sorted(layout.ranks) == list(range(len(layout.ranks)))
    for node, last in enumerate(layout.ends):
        ranks = sorted(layout.ranks[node : last + 1])
        assert ranks == list(range(layout.firsts[node], layout.ranks[node] + 1))
        assert layout.by_rank[layout.ranks[node]] == node


def test_a_condition_that_is_read_twice_guards_once() -> None:
    tree = build_tree(sequence(sequence(condition("c"), condition("c")), action("a")))
    layout = CompiledTree(ActivationNames(tree))
    guards = [layout.guards[number] for number in layout.guards_at(4)]
    assert guards == [("c", False)]


def test_a_retry_that_begins_anew_keeps_what_was_latched_below() -> None:
    inner = NodeSpec(
        Kind.SEQUENCE, (action("a"), condition("c"), action("b")), memory=Memory.UNTIL_SUCCESS
    )
    spec = NodeSpec(Kind.RETRY, (NodeSpec(Kind.RETRY, (inner,), limit=2),), limit=3)
    world = World(spec)
    compiled = CompiledEvaluator(world.mission.tree)
    for subject in ("a", "a", "a"):
        if subject in world.asked():
            world.outcome(world.activation(subject), True)
        found = world.evaluator.evaluate(world.facts)
        assert found == compiled.evaluate(world.facts)
