"""The local tasks of a lifted tree: trees that robots run, and the calls for them.

A piece that is a whole SubTree becomes that tree; for other pieces a tree is written. Constants,
passed to a SubTree or at the only node of a piece, become arguments of the local task if possible,
else its `ports`. So equal pieces are one local task.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, NAV2_NODES
from mrbt_mesh.btcpp.files.check_values import RESERVED_NAMES
from mrbt_mesh.btcpp.files.checkpoints import CHECKPOINT, checkpoints, is_marked
from mrbt_mesh.btcpp.files.document import (
    LEAVES,
    MODELS,
    SUBTREE,
    TREE,
    Category,
    Document,
    pointer,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element, write_content
from mrbt_mesh.btcpp.files.entries import access_below
from mrbt_mesh.btcpp.files.entry_flow import EntryFlow, entry_flow, flow_in_turn
from mrbt_mesh.btcpp.files.expand import ExpandedNode, ExpandedTree, constant_value
from mrbt_mesh.btcpp.files.export import explicit, model_element
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.files.loadable import loadable
from mrbt_mesh.btcpp.scripts.values import INTEGERS, REALS, as_text
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN, MAX_ARGUMENTS, NAME_PATTERN
from mrbt_mesh.errors import FileError, Problem

_NAME = re.compile(NAME_PATTERN)
_ARGUMENT = re.compile(ARGUMENT_PATTERN)
MARKS = TEAM, PARALLEL = "_team", "_parallel"
_LONGEST = 48  # so that a number and `_checkpoint` still fit


@dataclass(frozen=True)
class Piece:
    """What one robot does as one task: a node with everything below it, or neighbouring nodes.

    Neighbours replace their parent `within`. `is_again`: a loop of the team may restart it.
    """

    nodes: tuple[ExpandedNode, ...]
    within: ExpandedNode | None
    is_again: bool


@dataclass(frozen=True)
class LiftedTask:
    """A local task: its tree, its parameters, its ports, and whether it has checkpoints."""

    name: str
    tree: str
    parameters: tuple[str, ...]
    ports: Mapping[str, str]
    has_checkpoints: bool


@dataclass(frozen=True)
class TaskUse:
    """One place in the team's tree where a local task is called."""

    piece: Piece
    task: LiftedTask
    call: str


@dataclass
class TaskTrees:
    """All local tasks of the expanded tree `tree` of a library.

    `trees`: the <BehaviorTree> elements to write, by ID. `problems`: what cannot be a task.
    """

    library: Library
    tree: str
    expanded: ExpandedTree
    trees: dict[str, Element] = field(default_factory=dict)
    tasks: dict[str, LiftedTask] = field(default_factory=dict)
    uses: list[TaskUse] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    _tree_ids: dict[str, str] = field(default_factory=dict)
    _names: dict[tuple[object, ...], str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        found = access_below([self.expanded.root], self.library)
        # Entries that only the robot's program sets, by these names.
        self._outside = found.reads - found.writes - self.expanded.constants.keys()
        known = [each for tree in self.library.trees.values() for each in tree.element.walk()]
        self._taken = {*map(type_id, known), *self.library.trees, *self.library.models}
        self._taken |= {*BUILTIN, *NAV2_NODES, *RESERVED_NAMES}

    def flow(self, piece: Piece) -> EntryFlow:
        """Return the entries that a piece reads before it has written them."""
        if piece.within is not None and "Fallback" in piece.within.type:
            each = [entry_flow(node, self.library) for node in piece.nodes]
            return EntryFlow(frozenset().union(*(one.kept for one in each)), frozenset())
        return flow_in_turn(piece.nodes, self.library)

    def use(self, piece: Piece) -> str:
        """Return the call for a piece."""
        first, name = piece.nodes[0], self._wanted(piece)
        if first is self.expanded.root:
            tree, values = self.tree, dict[str, str]()
            self._add(tree, self.library.trees[tree].element)
        elif len(piece.nodes) == 1 and self._is_plain(first):
            tree, values = first.type, self.library.subtree_ports(first.element)[1]
            self._add(tree, self.library.trees[tree].element)
        else:
            content, values = self._content(piece, name)
            tree = self._tree(name, content)
        parameters = [key for key, value in values.items() if _is_argument(key, value)]
        del parameters[MAX_ARGUMENTS:]
        ports = {key: value for key, value in values.items() if key not in parameters}
        has_checkpoints = self._has_checkpoints(piece)
        task = self._task(name, tree, tuple(parameters), ports, has_checkpoints)
        arguments = ",".join(values[key] for key in parameters)
        call = f"{task.name}({arguments})" if parameters else task.name
        if has_checkpoints and any(use.call == call for use in self.uses):
            why = f"{call} is begun in two places, and its checkpoints would be those of both; "
            why += "give the two different ports"
            self.problems.append(Problem(first.file, first.line, first.path, why))
        self.uses.append(TaskUse(piece, task, call))
        return call

    def _has_checkpoints(self, piece: Piece) -> bool:
        """Return whether another robot can begin it in the middle.

        Errors are added to `problems`.
        """
        try:
            if not any(is_marked(n, CHECKPOINT) for top in piece.nodes for n in top.walk()):
                return False
            root = piece.nodes[0]
            if piece.within is not None:
                root = _like(piece.within, piece.nodes)
            checkpoints(root, self.library)
        except FileError as error:
            self.problems += error.problems
        return True

    def _wanted(self, piece: Piece) -> str:
        """Return the task's preferred name: the node's, or those of its first and last leaves."""
        first = piece.nodes[0]
        if first is self.expanded.root:
            name = self.tree
        elif len(piece.nodes) == 1 and first.category in (*LEAVES, Category.SUBTREE):
            name = first.type
        elif len(piece.nodes) == 1 and first.name != first.type:
            name = first.name
        else:
            leaves = [n for top in piece.nodes for n in top.walk() if not n.children]
            ends = [n.type for n in leaves if n.type not in BUILTIN] or [first.type]
            name = ends[0] if len(ends) == 1 else f"{ends[0]}_to_{ends[-1]}"
        name = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_")[:_LONGEST]
        return name if _NAME.fullmatch(name) else f"task_{name}".rstrip("_")

    # -- trees ------------------------------------------------------------------------------------

    def _is_plain(self, node: ExpandedNode) -> bool:
        """Return whether a SubTree can run as a separate tree, with values for its ports."""
        if node.category is not Category.SUBTREE or node.conditions:
            return False
        remaps_all, given, _ = self.library.subtree_ports(node.element)
        texts = [text for inner in node.walk() for text in inner.element.attributes.values()]
        is_constant = all(pointer(text, key) is None for key, text in given.items())
        is_outside = self._outside & access_below([node], self.library).reads
        is_alone = is_constant and not remaps_all and not is_outside
        return is_alone and not any("$" in text or "@" in text for text in texts)

    def _content(self, piece: Piece, name: str) -> tuple[Element, dict[str, str]]:
        """Return the root of a piece's tree, and the initial values of its entries."""
        first = piece.nodes[0]
        content = [node.element.copy() for node in piece.nodes]
        for element in (inner for each in content for inner in each.walk()):
            for mark in MARKS:
                element.attributes.pop(mark, None)
        (root,) = content if piece.within is None else [Element(piece.within.type, {}, [*content])]
        keys = self._keys(piece)
        fixed = self.expanded.constants
        values = {key: fixed[entry] for key, entry in keys.items() if entry in fixed}
        entries = [entry for entry in keys.values() if entry not in fixed]
        is_odd = len(set(entries)) < len(entries) or any("$" in text for text in values.values())
        for key, entry in keys.items():
            # Otherwise the program would set the wrong entry.
            is_odd = is_odd or (key != entry and bool({key, entry} & self._outside))
        if is_odd:
            attributes = {"ID": self._tree(name, root)}
            attributes |= {key: fixed.get(entry, f"{{{entry}}}") for key, entry in keys.items()}
            return Element(SUBTREE, attributes), {}
        is_task = first.category in LEAVES and first.type not in BUILTIN
        if piece.within is None and (is_task or first.category is Category.SUBTREE):
            values |= self._made_ports(first, root, {*keys, *self._outside})
        return root, values

    def _keys(self, piece: Piece) -> dict[str, str]:
        """Return the keys that a piece in a SubTree uses, and their entries.

        Empty in the main tree.
        """
        scope = piece.nodes[0].scope
        if scope.outer is None:
            return {}
        entries = set(access_below(piece.nodes, self.library).entries)
        for node in piece.nodes:
            entries |= {e for text in node.ports.values() if (e := pointer(text)) is not None}
        return {key: entry for entry in sorted(entries) for key in scope.names_of(entry)}

    def _made_ports(
        self, node: ExpandedNode, element: Element, taken: Iterable[str]
    ) -> dict[str, str]:
        """Turn the constants at a node into entries; return the values by port."""
        named = {pointer(text, key) for key, text in element.attributes.items()} | {*taken}
        model = self.library.model(node.type)
        found = {}
        for port in node.ports:
            text = element.get(port)
            value = constant_value(text)
            kind = model.ports[port].type if model and port in model.ports else ""
            is_enum = isinstance(value, str) and kind in (*INTEGERS, *REALS)
            is_same = _is_argument(port, text) and as_text(value) == text
            if pointer(text, port) is None and port not in named and is_same and not is_enum:
                found[port] = text
                element.attributes[port] = f"{{{port}}}"
        return found

    def _tree(self, name: str, root: Element) -> str:
        """Return the ID of the tree with this content."""
        text = write_content(root)
        if text not in self._tree_ids:
            wanted = f"{name}_task" if name in self._taken else name
            chosen = self._tree_ids[text] = _unique(wanted, self._taken)
            self._taken.add(chosen)
            self._add(chosen, Element(TREE, {"ID": chosen}, [root]))
        return self._tree_ids[text]

    def _add(self, name: str, tree: Element) -> None:
        """Add a tree, and those that it uses."""
        if name in self.trees:
            return
        self.trees[name] = tree.copy()
        self.trees[name].attributes["ID"] = name
        for element in tree.walk():
            inner = element.get("ID")
            if element.tag == SUBTREE and inner in self.library.trees:
                self._add(inner, self.library.trees[inner].element)

    def _task(
        self,
        name: str,
        tree: str,
        parameters: tuple[str, ...],
        ports: Mapping[str, str],
        has_checkpoints: bool,
    ) -> LiftedTask:
        key = (tree, parameters, tuple(ports.items()))
        if key not in self._names:
            chosen = self._names[key] = _unique(name, self.tasks)
            given = {parameter: f"${parameter}" for parameter in parameters} | dict(ports)
            self.tasks[chosen] = LiftedTask(chosen, tree, parameters, given, has_checkpoints)
        return self.tasks[self._names[key]]

    def document(self, file: str) -> Document:
        """Return the file with all trees, and the models of their nodes."""
        root = Element("root", {"BTCPP_format": "4"}, [*self.trees.values()])
        used = {type_id(each) for tree in self.trees.values() for each in tree.walk()}
        models = [m for name, m in self.library.models.items() if name in used]
        models += [m for name, m in self.library.subtree_models.items() if name in self.trees]
        if models:
            root.content.append(Element(MODELS, {}, [model_element(model) for model in models]))
        if len(self.trees) == 1:
            root.attributes["main_tree_to_execute"] = next(iter(self.trees))
        library = Library()
        library.add(Document(file, [root]))
        return loadable(explicit(library))


def _like(parent: ExpandedNode, children: tuple[ExpandedNode, ...]) -> ExpandedNode:
    """Return a control of the same type as `parent`, with only these children."""
    names = (parent.type, parent.category, parent.name, parent.path, parent.file, parent.line)
    made = ExpandedNode(*names, {}, {}, False, parent.element, parent.scope)
    made.children = list(children)
    return made


def _is_argument(key: str, value: str) -> bool:
    is_name = _NAME.fullmatch(key) is not None
    return is_name and _ARGUMENT.fullmatch(value) is not None and "$" not in value


def _unique(name: str, taken: Iterable[str]) -> str:
    number, chosen, known = 1, name, set(taken)
    while chosen in known:
        number += 1
        chosen = f"{name}_{number}"
    return chosen
