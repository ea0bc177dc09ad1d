"""Builds the nodes of a file's trees, with a blackboard for each SubTree.

The file has been checked already (`files.check`). This module checks what depends on the robot:
nodes that are not registered, unknown or missing ports of a leaf, SubTrees that no file defines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mrbt_mesh.btcpp.executor.blackboard import Blackboard
from mrbt_mesh.btcpp.executor.builtin_leaves import BUILTIN_LEAVES
from mrbt_mesh.btcpp.executor.controls import CONTROLS, Reactive
from mrbt_mesh.btcpp.executor.decorators import DECORATORS
from mrbt_mesh.btcpp.executor.leaf_nodes import ActionLeaf, LeafNode, SyncLeaf
from mrbt_mesh.btcpp.executor.leaves import Leaf, Leaves
from mrbt_mesh.btcpp.executor.nav2 import NAV2
from mrbt_mesh.btcpp.executor.node import (
    NodePlace,
    TickError,
    TreeNode,
    TreeWorld,
)
from mrbt_mesh.btcpp.executor.timed import TIMED
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, NAV2_NODES, entry_type
from mrbt_mesh.btcpp.files.check_nodes import child_path
from mrbt_mesh.btcpp.files.document import (
    SUBTREE,
    Category,
    conditions,
    instance_name,
    pointer,
    ports,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.expand import MAX_NODES, constant_value
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.files.xml_reader import MAX_LEVELS
from mrbt_mesh.btcpp.scripts.parser import parse
from mrbt_mesh.btcpp.scripts.script import ScriptError
from mrbt_mesh.btcpp.scripts.values import ANY_TYPE
from mrbt_mesh.errors import FileError, Problem, nearest

NODE_TYPES: Mapping[str, type[TreeNode]] = {
    **CONTROLS,
    **DECORATORS,
    **TIMED,
    **BUILTIN_LEAVES,
    **NAV2,
}
# A Python int may be either of these.
_PYTHON_INT = {"int", "int64_t"}
# An entry of one of these types matches every port.
_TEXT_OR_ANY = ("", "std::string", ANY_TYPE)


@dataclass
class _Where:
    """The place of an element: its file, the path above it, its blackboard."""

    file: str
    path: str
    board: Blackboard
    depth: int = 1

    def below(self, element: Element) -> _Where:
        path = child_path(self.path, element)
        return _Where(self.file, path, self.board, self.depth + 1)


def build_nodes(
    library: Library, tree: str, leaves: Leaves, world: TreeWorld, board: Blackboard
) -> list[TreeNode]:
    """Return all nodes of the tree in preorder, ready to be ticked. Raises FileError."""
    builder = _Builder(library, leaves, world)
    builder.tree(tree, Element("root"), _Where(library.documents[0].file, tree, board))
    if builder.problems:
        raise FileError(builder.problems)
    for node in builder.nodes:
        if isinstance(node, Reactive):
            for guard in node.children[:-1]:
                _keep_from_yielding(guard, world.exact)
    for node in builder.nodes:
        try:
            node.prepare()
        except TickError as error:
            builder.problems.append(
                Problem(node.place.file, node.place.line, node.place.path, str(error))
            )
    if builder.problems:
        raise FileError(builder.problems)
    return builder.nodes


def _keep_from_yielding(guard: TreeNode, is_exact: bool) -> None:
    """Make the nodes below `guard` decide within the tick, unless the tree is exact.

    Guards are all children of a reactive node except the last one.
    """
    if not is_exact:
        guard.yields = False
        for child in guard.children:
            _keep_from_yielding(child, is_exact)


@dataclass
class _Builder:
    library: Library
    leaves: Leaves
    world: TreeWorld
    nodes: list[TreeNode] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)

    def problem(self, where: _Where, line: int, message: str) -> None:
        self.problems.append(Problem(where.file, line, where.path, message))

    def tree(self, name: str, reference: Element, where: _Where) -> TreeNode | None:
        """Build the only child of a <BehaviorTree>. `reference` is the element that names it."""
        source = self.library.trees.get(name)
        if source is None:
            missing = ", ".join(self.library.missing_files)
            where_else = f"; it may be in {missing}, which was not read" if missing else ""
            hint = where_else or nearest(name, list(self.library.trees))
            self.problem(where, reference.line, f"there is no tree {name!r}{hint}")
            return None
        (child,) = source.element.children
        inner = _Where(source.document.file, where.path, where.board, where.depth)
        return self.node(child, inner.below(child))

    def node(self, element: Element, where: _Where) -> TreeNode | None:
        if len(self.nodes) >= MAX_NODES or where.depth > MAX_LEVELS:
            message = f"more than {MAX_NODES} nodes or {MAX_LEVELS} levels"
            raise FileError([Problem(where.file, element.line, where.path, message)])
        name = SUBTREE if element.tag == SUBTREE else type_id(element)
        leaf = None if self._node_type(name) else self.leaves.find(name)
        node = self._made(name, leaf, element, where)
        if node is None:
            return None
        self.nodes.append(node)
        node.uid = len(self.nodes)
        node.ports = ports(element)
        self._defaults(node, leaf)
        self._conditions(node, element, where)
        if name == SUBTREE:
            inner = self.tree(element.get("ID"), element, self._inner(element, where))
            node.children = [] if inner is None else [inner]
            return node
        self._check_children(node, element, where)
        self._ports(node, leaf, element, where)
        for child in element.children:
            built = self.node(child, where.below(child))
            if built is not None:
                node.children.append(built)
        return node

    def _made(
        self, name: str, leaf: Leaf | None, element: Element, where: _Where
    ) -> TreeNode | None:
        place = NodePlace(where.path, where.file, element.line)
        arguments = (name, self.world, where.board, place, instance_name(element))
        node_type = self._node_type(name)
        if node_type is not None:
            for source in node_type.SOURCES:
                if source not in self.world.sources:
                    message = f"{name} needs a function of the program: the source {source!r}"
                    self.problem(where, element.line, message)
            return node_type(*arguments)
        if leaf is None or element.children:
            what = "a control or decorator" if element.children else "an action or condition"
            hint = nearest(name, {*NODE_TYPES, *self.leaves.names()} - {"*"})
            self.problem(where, element.line, f"{name!r} is {what} that is not registered{hint}")
            return None
        model = self.library.models.get(name)
        category = model.category if leaf.name == "*" and model is not None else leaf.category
        is_action = leaf.is_async and category is not Category.CONDITION
        node: LeafNode = ActionLeaf(*arguments) if is_action else SyncLeaf(*arguments)
        node.leaf = leaf
        return node

    def _node_type(self, name: str) -> type[TreeNode] | None:
        """Return the class of a node type. The program may replace Nav2's nodes by its own."""
        if name in NAV2 and name in self.leaves.names():
            return self.leaves.node_types.get(name)
        return NODE_TYPES.get(name) or self.leaves.node_types.get(name)

    def _defaults(self, node: TreeNode, leaf: Leaf | None) -> None:
        model = self.library.model(node.type)
        if isinstance(node, tuple(NAV2.values())):
            model = NAV2_NODES[node.type]
        if model is not None:
            node.defaults = {
                port.name: port.default
                for port in model.ports.values()
                if port.default is not None and (leaf is None or port.default != "")
            }

    def _conditions(self, node: TreeNode, element: Element, where: _Where) -> None:
        scripts = {}
        for attribute, text in conditions(element).items():
            try:
                scripts[attribute] = parse(text)
            except ScriptError as error:
                self.problem(where, element.line, f"{attribute}: {error}")
        node.conditions = scripts

    def _check_children(self, node: TreeNode, element: Element, where: _Where) -> None:
        """Check the number of children of the program's and Nav2's nodes.

        BehaviorTree.CPP's own nodes have been checked already.
        """
        found = len(element.children)
        least, most = node.CHILDREN
        if node.type not in BUILTIN and (found < least or (most is not None and found > most)):
            wanted = str(least) if least == most else f"{least} or more" if most is None else ""
            wanted = wanted or f"{least} to {most}"
            self.problem(where, element.line, f"{node.type} needs {wanted} children, not {found}")
        asynchronous = [child for child in element.children if child.tag == "AsyncSequence"]
        if self.world.exact and node.type == "ReactiveSequence" and len(asynchronous) > 1:
            message = "BehaviorTree.CPP allows one AsyncSequence below a ReactiveSequence"
            self.problem(where, element.line, message)

    def _ports(self, node: TreeNode, leaf: Leaf | None, element: Element, where: _Where) -> None:
        """Declare the entries that ports point to; check the ports of a leaf."""
        if leaf is not None:
            self._check_ports(node, leaf, element, where)
        for name, text in node.ports.items():
            key = pointer(text, name)
            if key is None:
                continue
            type_name = self._entry_type(node, leaf, name)
            before = where.board.declare(key, type_name).type
            is_free = type_name in ("", ANY_TYPE, before) or before in _TEXT_OR_ANY
            is_free = is_free or {type_name, before} == _PYTHON_INT
            if self.world.exact and not is_free:
                message = (
                    f"port {name!r} is of type {type_name}, and its entry {key!r} of type {before}"
                )
                self.problem(where, element.line, f"{node.type}: {message}")

    def _entry_type(self, node: TreeNode, leaf: Leaf | None, port: str) -> str:
        """Return the type of a port's entry: that of the function, else that of the model."""
        if leaf is not None and port in leaf.ports:
            return leaf.ports[port].type
        model = self.library.model(node.type)
        if model is None or port not in model.ports:
            return ""
        return entry_type(node.type, model.ports[port]) or ""

    def _check_ports(self, node: TreeNode, leaf: Leaf, element: Element, where: _Where) -> None:
        for name in node.ports:
            if name not in leaf.ports and not leaf.takes_others:
                known = ", ".join(sorted(leaf.ports)) or "none"
                message = f"{node.type} has no port {name!r}; its ports: {known}"
                self.problem(where, element.line, message)
        for name, port in leaf.ports.items():
            given = node.ports.get(name, node.defaults.get(name))
            if port.writes and port.is_optional and given == "":
                # Editors write an omitted output port like this.
                continue
            is_lost = port.writes and given is not None and pointer(given, name) is None
            if given is None and not port.is_optional:
                self.problem(where, element.line, f"{node.type}: port {name!r} is missing")
            elif is_lost and (name in node.ports or not port.reads):
                # A default that is a plain value can only be read.
                message = f"{node.type}: port {name!r} is written, it needs an entry: {{{name}}}"
                self.problem(where, element.line, message)

    def _inner(self, element: Element, where: _Where) -> _Where:
        """Return the place inside a SubTree, with a blackboard of its own."""
        autoremap, given, missing = self.library.subtree_ports(element)
        board = Blackboard(where.board, autoremap, exact=self.world.exact)
        for name in missing:
            message = f"port {name!r} of tree {element.get('ID')!r} has to be given"
            self.problem(where, element.line, message)
        for name, text in given.items():
            outer = pointer(text, name)
            if outer is None:
                board.own(name, constant_value(text))
            else:
                board.remapped[name] = outer
        return _Where(where.file, where.path, board, where.depth)
