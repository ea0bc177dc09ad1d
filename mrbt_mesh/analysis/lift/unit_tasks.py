"""Units as local tasks: the trees that robots run, and the calls for them in the team's tree.

A unit that is a SubTree is that tree; of others a tree is written. Entries that are constants,
given to a SubTree or standing at the only leaf of a unit, become ports: as arguments of the local
task if they can be such, else in its `ports`. So equal units are one local task.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from mrbt_mesh.analysis.lift.unit_team import UnitTeam
from mrbt_mesh.analysis.lift.units import HandUnit, Piece
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.check_values import RESERVED_NAMES
from mrbt_mesh.btcpp.files.document import (
    LEAVES,
    MODELS,
    TREE,
    Category,
    Document,
    pointer,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element, write_content
from mrbt_mesh.btcpp.files.entries import access_below
from mrbt_mesh.btcpp.files.expand import ExpandedNode, Scope
from mrbt_mesh.btcpp.files.export import model_element
from mrbt_mesh.btcpp.files.loadable import loadable
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN, MAX_ARGUMENTS, NAME_PATTERN

_NAME = re.compile(NAME_PATTERN)
_ARGUMENT = re.compile(ARGUMENT_PATTERN)
_LONGEST = 56  # so that a number still fits
_LONGEST_TITLE = 64


@dataclass(frozen=True)
class UnitTask:
    """A local task that is a unit: its tree, its parameters, and entries with values."""

    name: str
    tree: str
    parameters: tuple[str, ...]
    ports: Mapping[str, str]
    nodes: tuple[ExpandedNode, ...]


@dataclass(frozen=True)
class UnitUse:
    """One use of a unit: the call in the team's tree, and the piece that was split off there."""

    piece: Piece
    task: UnitTask
    call: str


@dataclass
class UnitTasks:
    """All units of a tree. `trees`: the <BehaviorTree> elements by ID.

    `lacking`: entries without a value, each with its reader.
    """

    team: UnitTeam
    by_hand: Mapping[int, HandUnit]
    trees: dict[str, Element] = field(default_factory=dict)
    tasks: dict[str, UnitTask] = field(default_factory=dict)
    uses: list[UnitUse] = field(default_factory=list)
    lacking: dict[str, str] = field(default_factory=dict)
    _tree_ids: dict[str, str] = field(default_factory=dict)
    _task_names: dict[tuple[object, ...], str] = field(default_factory=dict)

    def team_tree(self, piece: Piece, parent: ExpandedNode | None = None) -> ExpandedNode:
        """The tree between units: each of them is one task there."""
        (first, *_) = piece.nodes
        if piece.is_unit:
            use = self._use(piece, parent)
            self.uses.append(use)
            return replace(
                first,
                type=use.task.name,
                category=Category.ACTION,
                name=use.call,
                ports={},
                conditions={},
                metadata={},
                children=[],
                call=use.call,
            )
        children = [self.team_tree(child, first) for child in piece.children]
        # A mission's names have no slash, which paths are made of.
        name = re.sub(r"[/\n]", "-", first.name)[:_LONGEST_TITLE]
        return replace(first, children=children, name=name)

    # -- one unit ---------------------------------------------------------------------------------

    def _use(self, piece: Piece, parent: ExpandedNode | None) -> UnitUse:
        nodes, scope, original = _inside(piece.nodes)
        content = [node.element.copy() for node in nodes]
        values = self._values(nodes, scope)
        if len(nodes) == 1 and nodes[0].category in LEAVES and nodes[0].type not in BUILTIN:
            values |= _made_ports(nodes[0], content[0])
        if len(content) > 1 and parent is not None:
            content = [Element(parent.type, {}, list(content))]
        name = self._wanted(piece, original)
        tree = self._tree(name, original, content)
        arguments = {
            key: value
            for key, value in values.items()
            if _NAME.fullmatch(key) and _ARGUMENT.fullmatch(value) and "$" not in value
        }
        if len(arguments) > MAX_ARGUMENTS:
            arguments = {}
        ports = {key: value for key, value in values.items() if key not in arguments}
        task = self._task(name, tree, tuple(arguments), ports, nodes)
        listed = ",".join(arguments.values())
        return UnitUse(piece, task, f"{task.name}({listed})" if listed else task.name)

    def _values(self, nodes: Sequence[ExpandedNode], scope: Scope) -> dict[str, str]:
        """The entries of a unit's own blackboard that have values before it begins."""
        found: dict[str, str] = {}
        given = self.team.team.model.parameters
        inner = [node for each in nodes for node in each.walk()]
        scopes = [node.children[0].scope for node in inner if _is_subtree(node)]
        inside = {each.prefix + key for each in scopes for key in each.own}
        used = access_below(nodes, self.team.library)
        for entry in sorted(used.entries - inside):
            keys = scope.names_of(entry)
            if not keys:
                continue
            if entry in self.team.tree.constants:
                found[keys[0]] = self.team.tree.constants[entry]
            elif entry in given:
                found[keys[0]] = f"${entry}"
            elif entry in self.team.unwritten:
                self.lacking.setdefault(entry, nodes[0].name)
        return found

    def _wanted(self, piece: Piece, original: str | None) -> str:
        inside = [id(node) for node in _all(piece.nodes)]
        by_hand = {self.by_hand[node].name for node in inside if node in self.by_hand}
        if by_hand:
            return min(by_hand)
        (first, *_) = piece.nodes
        if original is not None:
            name = original
        elif len(piece.nodes) == 1 and first.name != first.type:
            name = first.name
        else:
            types = [node.type for node in self.team.actions(piece.nodes)] or [first.type]
            name = types[0] if len(types) == 1 else f"{types[0]}_to_{types[-1]}"
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:_LONGEST] or "unit"
        return plain if _NAME.fullmatch(plain) else f"unit_{plain}"

    def _tree(self, name: str, original: str | None, content: list[Element]) -> str:
        """The ID of the tree with this content; equal ones are one."""
        if original is not None:
            self.trees.setdefault(original, self.team.library.trees[original].element)
            return original
        text = "\n".join(map(write_content, content))
        if text not in self._tree_ids:
            sources = self.team.library.trees
            nodes = (type_id(each) for one in sources.values() for each in one.element.walk())
            taken = {*self.trees, *sources, *BUILTIN, *RESERVED_NAMES, *self.team.types, *nodes}
            tree = name if name not in taken else f"{name}_unit"
            tree = _unique(tree, taken)
            self._tree_ids[text] = tree
            self.trees[tree] = Element(TREE, {"ID": tree}, list(content))
        return self._tree_ids[text]

    def _task(
        self,
        name: str,
        tree: str,
        parameters: tuple[str, ...],
        ports: Mapping[str, str],
        nodes: tuple[ExpandedNode, ...],
    ) -> UnitTask:
        key = (tree, parameters, tuple(ports.items()))
        if key not in self._task_names:
            chosen = _unique(name, self.tasks)
            self._task_names[key] = chosen
            all_ports = {parameter: f"${parameter}" for parameter in parameters} | dict(ports)
            self.tasks[chosen] = UnitTask(chosen, tree, parameters, all_ports, nodes)
        return self.tasks[self._task_names[key]]

    # -- the file ---------------------------------------------------------------------------------

    def document(self, file: str) -> Document:
        """The units' trees, what SubTrees they use, and the models of their nodes."""
        library = self.team.library
        root = Element("root", {"BTCPP_format": "4"})
        trees = dict(self.trees)
        for use in self.uses:
            for node in _all(use.piece.nodes):
                if _is_subtree(node) and node.type not in trees and _is_used(node, trees):
                    trees[node.type] = library.trees[node.type].element
        root.content = [tree.copy() for tree in trees.values()]
        types = [
            element.get("ID") or element.tag for tree in trees.values() for element in tree.walk()
        ]
        known = [library.models[name] for name in dict.fromkeys(types) if name in library.models]
        known += [library.subtree_models[n] for n in trees if n in library.subtree_models]
        if known:
            root.content.append(Element(MODELS, {}, [model_element(model) for model in known]))
        return loadable(Document(file, [root]))


def _inside(
    nodes: tuple[ExpandedNode, ...],
) -> tuple[tuple[ExpandedNode, ...], Scope, str | None]:
    """What a unit consists of, its blackboard, and the tree that it is, if it is a SubTree."""
    original = None
    while len(nodes) == 1 and _is_subtree(nodes[0]) and _is_plain(nodes[0]):
        original = nodes[0].type
        nodes = (nodes[0].children[0],)
    return nodes, nodes[0].scope, original


def _is_plain(node: ExpandedNode) -> bool:
    """Whether a SubTree can be a tree of its own, with values for what it is given."""
    scope = node.children[0].scope
    if node.conditions or len(set(scope.remapped.values())) < len(scope.remapped):
        return False
    if scope.autoremap and any(key != outer for key, outer in scope.remapped.items()):
        return False
    texts = [text for inner in node.walk() for text in inner.element.attributes.values()]
    return not any("$" in text or "@" in text for text in texts)


def _made_ports(node: ExpandedNode, element: Element) -> dict[str, str]:
    """Make ports of the constants at a leaf; the values by port."""
    named = {pointer(text, key) for key, text in element.attributes.items()}
    found = {}
    for port in node.ports:
        text = element.get(port)
        free = pointer(text, port) is None and port not in named
        if free and "$" not in text and _NAME.fullmatch(port) and not text.startswith("json:"):
            found[port] = text
            element.attributes[port] = f"{{{port}}}"
    return found


def _is_subtree(node: ExpandedNode) -> bool:
    return node.category is Category.SUBTREE and bool(node.children)


def _is_used(node: ExpandedNode, trees: Mapping[str, Element]) -> bool:
    """Whether a SubTree is used as such in the trees that are written."""
    return any(
        (element.get("ID") or element.tag) == node.type
        for tree in trees.values()
        for element in tree.walk()
        if element is not tree
    )


def _all(nodes: Iterable[ExpandedNode]) -> list[ExpandedNode]:
    return [inner for node in nodes for inner in node.walk()]


def _unique(name: str, taken: Iterable[str]) -> str:
    number, chosen, known = 1, name, set(taken)
    while chosen in known:
        number += 1
        chosen = f"{name}_{number}"
    return chosen
