"""Conditions that stand before actions, told from the tree without the product's guards."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

from mrbt_mesh.core.bt.evaluation import OwnFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import conditions_in
from mrbt_mesh.core.bt.tree import Kind, Memory, Status, Tree, build_tree


@dataclass(frozen=True)
class Barrier:
    """A subtree of conditions alone, and the actions that it can keep from being reached.

    While `evaluator` says `against`, the nodes `behind` are out of reach.
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
