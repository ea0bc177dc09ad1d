"""The trees of local tasks, as views draw them below T_Li.

A robot reports the statuses of the nodes of the tree that it runs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

from mrbt_mesh.btcpp.files.document import LEAVES, Category, parse_document
from mrbt_mesh.btcpp.files.expand import ExpandedNode, expand
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.mission.program_trees import ProgramTree

MAX_PORT_CHARACTERS = 40
_INNER = re.compile(r"\{(\w+_[0-9]+__)+")


@lru_cache(maxsize=64)
def program_tree(program: ProgramTree) -> ExpandedNode:
    """Return the tree with its SubTrees expanded. Raises FileError for an invalid tree."""
    library = library_of(parse_document(program.xml, program.source), Findings())
    return expand(library, program.tree).root


def trees_by_type(mission: Mission) -> dict[str, ProgramTree]:
    """Return one tree for each type of local task that has one."""
    found: dict[str, ProgramTree] = {}
    for ground, tree in sorted(mission.program_trees.items()):
        found.setdefault(type_name(ground), tree)
    return found


def node_label(node: ExpandedNode) -> str:
    """Return a short text for people: the type, the node's own name, and the ports of a leaf."""
    text = node.type if node.name == node.type else f"{node.name} ({node.type})"
    if node.category is Category.SUBTREE or not node.ports:
        return text
    shown = ", ".join(f"{name}={_short(value)}" for name, value in node.ports.items())
    return f"{text}({shown})" if node.category in LEAVES else f"{text} {shown}"


def _short(value: str) -> str:
    # Show an entry of a SubTree under the name that its file gives it.
    text = _INNER.sub("{", " ".join(value.split()))
    return text if len(text) <= MAX_PORT_CHARACTERS else text[: MAX_PORT_CHARACTERS - 1] + "…"


def with_inner_trees(
    rows: Sequence[Mapping[str, Any]],
    statuses: Sequence[int],
    mission: Mission,
    running: tuple[str, bytes] = ("", b""),
) -> tuple[list[dict[str, Any]], list[int]]:
    """Return the rows of T_Li and their statuses, with the trees of local tasks below them.

    `running` is the local task that is carried out, and the statuses of the nodes of its tree.
    """
    trees = trees_by_type(mission)
    found: list[dict[str, Any]] = []
    after: list[int] = []
    moved: dict[int, int] = {-1: -1}
    for index, row in enumerate(rows):
        moved[index] = here = len(found)
        found.append({**row, "parent": moved[int(row["parent"])]})
        after.append(statuses[index])
        if row["kind"] == Kind.ACTION and row["subject"] in trees:
            inner = list(_rows(trees[row["subject"]], here, len(found)))
            found += inner
            is_reported = type_name(running[0]) == row["subject"] and len(running[1]) == len(inner)
            after += running[1] if is_reported else bytes(len(inner))
    return found, after


def _rows(tree: ProgramTree, parent: int, first: int) -> Iterator[dict[str, Any]]:
    waiting = [(program_tree(tree), parent)]
    number = first
    while waiting:
        node, above = waiting.pop()
        is_leaf = node.category in LEAVES or node.category is Category.SUBTREE
        yield {
            "kind": str(node.category) if is_leaf else node.type,
            "label": node_label(node),
            "name": node.name,
            "subject": node.type if node.category in LEAVES else "",
            "parent": above,
        }
        waiting += [(child, number) for child in reversed(node.children)]
        number += 1
