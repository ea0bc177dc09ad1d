"""The nodes that the author marked as the team's, in the file or on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mrbt_mesh.analysis.lift.tasks import PARALLEL, TEAM
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.checkpoints import is_marked, problem_at
from mrbt_mesh.btcpp.files.document import Category
from mrbt_mesh.btcpp.files.expand import ExpandedNode
from mrbt_mesh.errors import InputError, nearest

_PARALLEL_KINDS = ("Sequence", "Fallback")


@dataclass(frozen=True)
class WantedMarks:
    """Marks besides those in the file: nodes by path or name. `every_action` marks all actions."""

    team: Sequence[str] = ()
    parallel: Sequence[str] = ()
    every_action: bool = False


@dataclass(frozen=True)
class Marks:
    """The marked nodes of one expanded tree, by identity.

    `above` maps the nodes that the team carries out itself to their first marked node, or to
    themselves. These are the nodes above a marked one, and the parallel ones.
    """

    team: frozenset[int]
    parallel: frozenset[int]
    above: dict[int, ExpandedNode]


def find_marks(root: ExpandedNode, wanted: WantedMarks) -> Marks:
    """Return the marks of a tree. Raises InputError for a mark without a node or without a
    meaning.
    """
    nodes = list(root.walk())
    team = [node for node in nodes if is_marked(node, TEAM)]
    team += _named(nodes, wanted.team, "--team")
    if wanted.every_action:
        team += [n for n in nodes if n.category is Category.ACTION and n.type not in BUILTIN]
    parallel = [node for node in nodes if is_marked(node, PARALLEL)]
    parallel += _named(nodes, wanted.parallel, "--parallel")
    for node in team:
        if node.category is Category.CONDITION:
            raise problem_at(node, f"{TEAM}: a condition is not a task; mark the node above it")
    for node in parallel:
        if node.type not in _PARALLEL_KINDS:
            raise problem_at(node, f"{PARALLEL}: only a Sequence or a Fallback, not {node.type}")
    own = frozenset(map(id, parallel))
    above = {id(node): node for node in parallel}
    _find_above(root, own | frozenset(map(id, team)), above)
    return Marks(frozenset(map(id, team)), own, above)


def _find_above(root: ExpandedNode, marked: frozenset[int], above: dict[int, ExpandedNode]) -> None:
    waiting: list[tuple[ExpandedNode, tuple[ExpandedNode, ...]]] = [(root, ())]
    while waiting:
        node, path = waiting.pop()
        if id(node) in marked:
            for each in path:
                above.setdefault(id(each), node)
        waiting += [(child, (*path, node)) for child in reversed(node.children)]


def _named(nodes: Sequence[ExpandedNode], names: Sequence[str], option: str) -> list[ExpandedNode]:
    """Return the nodes with these paths, with or without the tree's ID or a line, or these names.

    A leaf or a SubTree is also named by its type.
    """
    found = []
    for name in names:
        matching = [node for node in nodes if name in _names(node)]
        if not matching:
            known = [each for node in nodes for each in _names(node)[1:]]
            raise InputError(f"{option} {name}: there is no such node{nearest(name, known)}")
        found += matching
    return found


def _names(node: ExpandedNode) -> tuple[str, ...]:
    has_name = node.name != node.type or not node.children or node.category is Category.SUBTREE
    paths = (f"{node.path}:{node.line}", node.path, node.path.partition("/")[2])
    return (*paths, node.name, node.type) if has_name else paths
