"""What a robot must have to work behind a condition of its own, told from the tree alone."""

from __future__ import annotations

from collections.abc import Iterator

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Kind, Memory, Node
from mrbt_mesh.core.facts.team_facts import TeamFacts


def lacked(facts: TeamFacts, activation: str, robot: str) -> str:
    """A condition that every robot has for itself, that stands before an activation and does not
    hold for this robot; empty if there is none.

    It stands before if it is left of it in a Sequence without memory, alone or as the first child
    of a Fallback with an action. Of compound conditions nothing is told.
    """
    own = facts.mission.own
    if not own.leaves:
        return ""
    for name in _before(facts, parse_activation(activation).node):
        if name in own and not facts.condition_of(robot, name):
            return name
    return ""


def _before(facts: TeamFacts, index: int) -> Iterator[str]:
    nodes = facts.mission.tree.nodes
    while nodes[index].parent >= 0:
        parent = nodes[nodes[index].parent]
        if parent.kind is Kind.SEQUENCE and parent.memory is Memory.NONE:
            for sibling in parent.children[: parent.children.index(index)]:
                yield from _asked(nodes, nodes[sibling])
        index = parent.index


def _asked(nodes: tuple[Node, ...], node: Node) -> Iterator[str]:
    if node.kind is Kind.CONDITION:
        yield node.subject
    elif node.kind is Kind.FALLBACK and node.memory is Memory.NONE and len(node.children) == 2:
        first, second = (nodes[child] for child in node.children)
        if first.kind is Kind.CONDITION and second.kind is Kind.ACTION:
            yield first.subject
