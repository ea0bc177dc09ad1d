"""A tree as BehaviorTree.CPP tells it to a monitor: XML with a `_uid` at every node.

The node of index n in the tree has the uid n + 1: both are numbered depth first.
"""

from __future__ import annotations

from mrbt_mesh.analysis.team_tree_writer import team_tree_document
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.document import MODELS, TREE, Document, type_id
from mrbt_mesh.btcpp.files.elements import Element, write_content
from mrbt_mesh.btcpp.files.export import model_element, with_ids
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.files.loadable import compact
from mrbt_mesh.core.bt.tree import Kind, Tree
from mrbt_mesh.errors import InputError

# Uids are 16 bits wide on the wire.
MAX_UID = (1 << 16) - 1


class FullTree:
    """The XML of one tree, and which conditions are read in which part of it."""

    def __init__(self, tree: Tree, title: str) -> None:
        """Raises InputError for a tree of more nodes than there are uids."""
        if len(tree.nodes) > MAX_UID:
            raise InputError(f"{title}: {len(tree.nodes)} nodes, Groot2's protocol has {MAX_UID}")
        library = Library()
        library.add(team_tree_document(tree.spec(), title))
        document = with_ids(library)
        self.blackboards = _conditions(tree, document)
        self.xml = _xml(document)


def _xml(document: Document) -> str:
    """The compact form, with models of every kind of node in it, as BehaviorTree.CPP writes it."""
    used = {type_id(element) for tree in document.trees for element in tree.walk()}
    root = compact(document).root
    models = next((each for each in root.children if each.tag == MODELS), None)
    if models is None:
        models = Element(MODELS)
        root.content.append(models)
    models.content.extend(model_element(BUILTIN[name]) for name in sorted(used & BUILTIN.keys()))
    return write_content(root) + "\n"


def _conditions(tree: Tree, document: Document) -> dict[str, tuple[str, ...]]:
    """Name of a blackboard -> the conditions read in its tree, or below it.

    The first tree's blackboard is called by its ID, those of others by their path.
    """
    found: dict[str, tuple[str, ...]] = {}
    for number, element in enumerate(each for each in document.root.children if each.tag == TREE):
        uid = next(int(inner.get("_uid")) for inner in element.walk() if inner is not element)
        name = element.get("ID") if number == 0 else element.get("_fullpath")
        found[name] = _conditions_below(tree, uid - 1)
    return found


def _conditions_below(tree: Tree, index: int) -> tuple[str, ...]:
    waiting, found = [index], []
    while waiting:
        node = tree.nodes[waiting.pop()]
        waiting.extend(reversed(node.children))
        if node.kind is Kind.CONDITION:
            found.append(node.subject)
    return tuple(dict.fromkeys(found))
