"""What a robot must have to work behind conditions of its own, told from the tree alone."""

from __future__ import annotations

from collections.abc import Iterator

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Kind, Memory, Status, Tree
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.sim.checkers.barriers import Barrier, actions_below, barriers


def lacked(facts: TeamFacts, activation: str, robot: str) -> str:
    """The conditions that keep a robot from an activation, with its own values in their places.

    Empty if there are none. Looked at is what the robots have for themselves and what stands left
    of the activation in a Sequence or Fallback without memory, or in such a Sequence as the first
    child of a Fallback with an action.
    """
    own = facts.mission.own
    if not own.leaves:
        return ""
    node = parse_activation(activation).node
    tree = facts.mission.tree
    for barrier in (*barriers(tree), *_alternatives(tree)):
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
    for node in nodes:
        if node.kind is not Kind.SEQUENCE or node.memory is not Memory.NONE:
            continue
        for position, child in enumerate(node.children):
            inner = nodes[child]
            if inner.kind is not Kind.FALLBACK or inner.memory is not Memory.NONE:
                continue
            first, *others = inner.children
            if not acts[first] and len(others) == 1 and nodes[others[0]].kind is Kind.ACTION:
                behind = actions_below(tree, node.children[position + 1 :])
                yield Barrier.of(tree, first, Status.FAILURE, behind)
