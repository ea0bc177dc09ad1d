"""Trees as people read them: status marks, and ended subtrees folded to one line."""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.cli.printing import PrintedTree, Styled
from mrbt_mesh.cli.views.marks import MARKS
from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.tree import LEAVES, Kind, Node, Status, Tree


def mark(status: Status, text: str = "") -> Styled:
    """Return a status mark and a text."""
    sign, style = MARKS[status]
    return Styled.assemble((sign, style), " ", (text, "dim" if status is Status.IDLE else ""))


def render_tree(tree: Tree, evaluation: Evaluation, notes: Mapping[int, Styled]) -> PrintedTree:
    """Return the tree with a mark per node, open below nodes that run.

    `notes` maps nodes to texts behind their labels.
    """

    def add(node: Node, parent: PrintedTree | None) -> PrintedTree:
        status = evaluation.status_of(node.index)
        label = mark(status, node.label)
        if node.index in notes:
            label.append("  ")
            label.append_text(notes[node.index])
        branch = PrintedTree(label) if parent is None else parent.add(label)
        if node.kind is Kind.SUBTREE:
            # Its only child has the same status, and a less useful name.
            node = tree.nodes[node.children[0]]
        if node.kind not in LEAVES and status is Status.RUNNING:
            for child in node.children:
                add(tree.nodes[child], branch)
        return branch

    return add(tree.nodes[0], None)
