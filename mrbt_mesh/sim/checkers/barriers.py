"""Conditions that an action waits for, found in the tree without the product's guards."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import OwnFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import conditions_in
from mrbt_mesh.core.bt.tree import Kind, Memory, Node, NodeSpec, Status, Tree, build_tree
from mrbt_mesh.core.facts.team_facts import TeamFacts


@dataclass(frozen=True)
class Barrier:
    """A subtree of conditions alone, and the actions that it can keep from being reached.

    While `evaluator` returns `against`, the nodes `behind` cannot be reached.
    """

    evaluator: Evaluator
    conditions: tuple[str, ...]
    against: Status
    behind: frozenset[int]

    @staticmethod
    def of(tree: Tree, index: int, against: Status, behind: frozenset[int]) -> Barrier:
        """The one at a node."""
        spec = tree.spec(index)
        names = tuple(sorted(conditions_in(spec)))
        return Barrier(Evaluator(build_tree(spec)), names, against, behind)

    def keeps_out(self, holding: Collection[str]) -> bool:
        """Whether what is behind is out of reach, where these conditions hold."""
        return self.evaluator.evaluate(OwnFacts(holding)).status is self.against


def barriers(tree: Tree) -> Iterator[Barrier]:
    """Those left of actions in Sequences and Fallbacks without memory."""
    acts, reads = tree.containing(Kind.ACTION), tree.containing(Kind.CONDITION)
    against = {Kind.SEQUENCE: Status.FAILURE, Kind.FALLBACK: Status.SUCCESS}
    for node in tree.nodes:
        if node.kind not in against or node.memory is not Memory.NONE:
            continue
        for position, child in enumerate(node.children):
            behind = actions_below(tree, node.children[position + 1 :])
            if behind and reads[child] and not acts[child]:
                yield Barrier.of(tree, child, against[node.kind], behind)


def actions_below(tree: Tree, indexes: Iterable[int]) -> frozenset[int]:
    """The actions at or below these nodes."""
    found: set[int] = set()
    for index in indexes:
        node = tree.nodes[index]
        if node.kind is Kind.ACTION:
            found.add(index)
        found |= actions_below(tree, node.children)
    return frozenset(found)


def lacked(facts: TeamFacts, activation: str, robot: str) -> str:
    """The conditions that keep a robot from an activation, with its own values in their places.

    Empty if there are none. Considered are per-robot conditions left
    of the activation in a Sequence or Fallback without memory, or in such a Sequence as the first
    child of a Fallback with an action, or as the alternative to actions that have failed.
    """
    own = facts.mission.entries
    if not own.leaves:
        return ""
    found = parse_activation(activation)
    node = facts.mission.evaluator.index_of.get((found.node, found.job), -1)
    tree = facts.mission.tree
    for barrier in (*barriers(tree), *_alternatives(tree), *_last_resorts(facts)):
        is_own = any(map(own.is_own, barrier.conditions))
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
