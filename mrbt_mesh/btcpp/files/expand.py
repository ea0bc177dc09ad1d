"""Expands a tree: SubTrees are replaced by their trees, and all blackboards are merged into one.

Every SubTree has a blackboard of its own. On the merged blackboard, its entries get unique names,
except those that are remapped to an outer blackboard.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from mrbt_mesh.btcpp.files.builtin_nodes import category_of
from mrbt_mesh.btcpp.files.check_nodes import child_path
from mrbt_mesh.btcpp.files.document import (
    EXPLICIT_TAGS,
    Category,
    conditions,
    instance_name,
    metadata,
    pointer,
    ports,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.files.xml_reader import MAX_LEVELS
from mrbt_mesh.btcpp.scripts.evaluator import Value
from mrbt_mesh.btcpp.scripts.parser import parse
from mrbt_mesh.btcpp.scripts.script import ScriptError, renamed
from mrbt_mesh.btcpp.scripts.values import read_real
from mrbt_mesh.errors import FileError, Problem

MAX_NODES = 20_000
_INTEGER = re.compile(r"-?[0-9]{1,30}", re.ASCII)

# Ports that hold scripts, whose names are blackboard entries.
SCRIPT_PORTS = {"Script": "code", "ScriptCondition": "code", "Precondition": "if"}


@dataclass(slots=True)
class Scope:
    """The blackboard of one SubTree, mapped to the merged blackboard.

    `remapped`: keys that stand for keys of the outer scope. `own`: keys that were given constants.
    """

    prefix: str
    outer: Scope | None = None
    autoremap: bool = False
    remapped: dict[str, str] = field(default_factory=dict)
    own: set[str] = field(default_factory=set)

    def entry(self, key: str) -> str:
        """Return the name of entry `key` on the merged blackboard."""
        if key.startswith("@"):
            return key[1:]
        if self.outer is None or key in self.own:
            return self.prefix + key
        if key in self.remapped:
            return self.outer.entry(self.remapped[key])
        if self.autoremap and not key.startswith("_"):
            return self.outer.entry(key)
        return self.prefix + key

    def names_of(self, entry: str) -> list[str]:
        """Return the keys of this scope that stand for an entry of the merged blackboard."""
        keys = [entry.removeprefix(self.prefix)] if entry.startswith(self.prefix) else []
        if self.outer is not None:
            outside = set(self.outer.names_of(entry))
            keys += [key for key, outer_key in self.remapped.items() if outer_key in outside]
            keys += sorted(outside) if self.autoremap else []
        return [key for key in dict.fromkeys(keys) if self.entry(key) == entry]


@dataclass(slots=True)
class ExpandedNode:
    """A node of the expanded tree; pointers and scripts name entries of the merged blackboard.

    A SubTree has its tree as its only child, or no child if there is no such tree. `is_guessed`:
    the category is a guess, because the node has the compact form and no model. `metadata`:
    attributes that BehaviorTree.CPP keeps and ignores. `element` is the node in its file, where
    entries have their names in `scope`. `call`: the task that replaces the node in a team.
    """

    type: str
    category: Category
    name: str
    path: str
    file: str
    line: int
    ports: dict[str, str]
    conditions: dict[str, str]
    is_guessed: bool
    element: Element
    scope: Scope
    metadata: dict[str, str] = field(default_factory=dict)
    children: list[ExpandedNode] = field(default_factory=list)
    call: str = ""

    def walk(self) -> Iterator[ExpandedNode]:
        """Yield this node and its descendants in preorder."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting.extend(reversed(node.children))


@dataclass(slots=True)
class ExpandedTree:
    """An expanded tree. `constants` are the entries that SubTrees were given as constants."""

    root: ExpandedNode
    constants: dict[str, str]

    def blackboard(self) -> dict[str, Value]:
        """Return the entries of the merged blackboard before the first tick."""
        return {key: constant_value(text) for key, text in self.constants.items()}


def constant_value(text: str) -> Value:
    """Convert a SubTree's constant like BehaviorTree.CPP to an integer, real number or text."""
    if _INTEGER.fullmatch(text) and -(2**63) <= int(text) < 2**63:
        return int(text)
    number = read_real(text)
    return text if number is None else number


def expand(library: Library, tree: str) -> ExpandedTree:
    """Expand the tree called `tree` with all its SubTrees.

    Raises FileError for trees that contain themselves, and for more than `MAX_NODES` nodes.
    """
    expansion = _Expansion(library)
    root = expansion.tree(tree, Scope(""), (tree,), tree, 1)
    return ExpandedTree(root, expansion.constants)


class _Expansion:
    def __init__(self, library: Library) -> None:
        self.library = library
        self.constants: dict[str, str] = {}
        self.nodes = 0
        self.subtrees = 0

    def tree(
        self, tree: str, scope: Scope, trees: tuple[str, ...], path: str, depth: int
    ) -> ExpandedNode:
        source = self.library.trees[tree]
        children = source.element.children
        file = source.document.file
        if len(children) != 1:
            message = f"the tree needs exactly one child, it has {len(children)}"
            raise FileError([Problem(file, source.element.line, path, message)])
        return self.node(children[0], scope, trees, path, file, depth)

    def node(
        self,
        element: Element,
        scope: Scope,
        trees: tuple[str, ...],
        above: str,
        file: str,
        depth: int,
    ) -> ExpandedNode:
        path = child_path(above, element)
        name = type_id(element)
        models = self.library.models
        category = category_of(name, element.tag, models, len(element.children))
        self.nodes += 1
        if self.nodes > MAX_NODES or depth > MAX_LEVELS:
            limit = f"{MAX_NODES} nodes or {MAX_LEVELS} levels"
            message = f"the tree has more than {limit} once its SubTrees are in place"
            raise FileError([Problem(file, element.line, path, message)])
        node = ExpandedNode(
            name,
            category,
            instance_name(element),
            path,
            file,
            element.line,
            {
                port: self.resolved(name, port, value, scope)
                for port, value in ports(element).items()
            },
            {key: _script(value, scope) for key, value in conditions(element).items()},
            self.library.model(name) is None and element.tag not in EXPLICIT_TAGS,
            element,
            scope,
            metadata(element),
        )
        if category is Category.SUBTREE:
            if name in trees:
                cycle = " -> ".join([*trees, name])
                message = f"a tree cannot contain itself: {cycle}"
                raise FileError([Problem(file, element.line, path, message)])
            if name in self.library.trees:
                inner = self.inner_scope(element, name, scope)
                node.children.append(self.tree(name, inner, (*trees, name), path, depth + 1))
            return node
        for child in element.children:
            node.children.append(self.node(child, scope, trees, path, file, depth + 1))
        return node

    def resolved(self, name: str, port: str, value: str, scope: Scope) -> str:
        """Return a port's value with entries named as on the merged blackboard."""
        key = pointer(value, port)
        if key is not None:
            return f"{{{scope.entry(key)}}}"
        return _script(value, scope) if SCRIPT_PORTS.get(name) == port else value

    def inner_scope(self, element: Element, name: str, outer: Scope) -> Scope:
        """Return the scope of a SubTree; notes the constants it is given."""
        self.subtrees += 1
        safe = re.sub(r"\W", "_", name)
        autoremap, given, _ = self.library.subtree_ports(element)
        scope = Scope(f"{safe}_{self.subtrees}__", outer, autoremap)
        for key, value in given.items():
            outer_key = pointer(value, key)
            if outer_key is not None:
                scope.remapped[key] = outer_key
            else:
                scope.own.add(key)
                self.constants[scope.entry(key)] = value
        return scope


def _script(text: str, scope: Scope) -> str:
    """Rename a script's entries as on the merged blackboard; an unreadable script is kept."""
    try:
        script = parse(text)
    except ScriptError:
        return text
    return str(renamed(script, scope.entry)) if scope.outer or "@" in text else text
