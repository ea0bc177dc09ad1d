"""What a robot must have to work behind conditions of its own, told from the tree alone."""

from __future__ import annotations

from collections.abc import Iterator

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Kind, Memory, Node, NodeSpec, Status, Tree, build_tree
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.sim.checkers.barriers import Barrier, actions_below, barriers


def lacked(facts: TeamFacts, activation: str, robot: str) -> str:
    """The conditions that keep a robot from an activation, with its own values in their places.

    Empty if there are none. Looked at is what the robots have for themselves and what stands left
    of the activation in a Sequence or Fallback without memory, or in such a Sequence as the first
    child of a Fallback with an action, or as the alternative to actions that have failed.
    """
    own = facts.mission.per_robot
    if not own.leaves:
        return ""
    node = parse_activation(activation).node
    tree = facts.mission.tree
    for barrier in (*barriers(tree), *_alternatives(tree), *_last_resorts(facts)):
        is_own = any(name in own for name in barrier.conditions)
        if is_own and node in barrier.behind:
            holding = {c for c in barrier.conditions if facts.condition_of(robot, c)}
            team = set(filter(facts.condition, barrier.conditions))
            if barrier.keeps_out(holding) and not barrier.keeps_out(team):
                return ", ".join(barrier.conditions)
    return ""


def _alternatives(tree: Tree) -> Iterator[Barrier]:
    """Of Fallbacks with conditions before an action that is to make them true."""
    acts, nodes = tree.containing(Kind.ACTION), tree.nodes
    for fallback, behind in _fallbacks(tree):
        first, *others = fallback.children
        if not acts[first] and len(others) == 1 and nodes[others[0]].kind is Kind.ACTION:
            yield Barrier.of(tree, first, Status.FAILURE, behind)


def _last_resorts(facts: TeamFacts) -> Iterator[Barrier]:
    """Of Fallbacks whose actions have all failed: the conditions that let the team go on."""
    tree = facts.mission.tree
    acts = tree.containing(Kind.ACTION)
    statuses = facts.mission.evaluator.evaluate(facts).statuses
    for fallback, behind in _fallbacks(tree):
        reads = [each for each in fallback.children if not acts[each]]
        tried = [each for each in fallback.children if acts[each]]
        if reads and all(statuses[each] == Status.FAILURE for each in tried):
            spec = NodeSpec(Kind.FALLBACK, tuple(map(tree.spec, reads)))
            yield Barrier.of(build_tree(spec), 0, Status.FAILURE, behind)


def _fallbacks(tree: Tree) -> Iterator[tuple[Node, frozenset[int]]]:
    """The Fallbacks in Sequences, all without memory, and the actions right of them."""
    for node in tree.nodes:
        if node.kind is Kind.SEQUENCE and node.memory is Memory.NONE:
            for position, child in enumerate(node.children):
                inner = tree.nodes[child]
                if inner.kind is Kind.FALLBACK and inner.memory is Memory.NONE:
                    yield inner, actions_below(tree, node.children[position + 1 :])
