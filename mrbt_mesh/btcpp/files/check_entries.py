"""Checks blackboard entries as BehaviorTree.CPP does when it creates a tree.

An entry gets its type from the first port in the tree that names it, or from the number that a
SubTree passes to it. Every later port must have the same type, unless the entry is a text or may
hold anything. Scripts in ports are parsed when the tree is created.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from mrbt_mesh.btcpp.files.builtin_nodes import SCRIPT, TEXT, entry_type
from mrbt_mesh.btcpp.files.check_values import script_problem
from mrbt_mesh.btcpp.files.document import SUBTREE, Category, Direction, Port, pointer, ports
from mrbt_mesh.btcpp.files.expand import ExpandedNode, constant_value, expand
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.cpp_types import is_one_type
from mrbt_mesh.btcpp.scripts.values import ANY_TYPE, type_of_value
from mrbt_mesh.errors import FileError

_FREE = ("", ANY_TYPE)
_LAST = {**dict.fromkeys(_FREE, 1), TEXT: 2}


def check_entries(library: Library, findings: Findings) -> None:
    """Check the entries of the main tree and of all trees that no other tree contains."""
    reached: set[str] = set()
    for name in _tops(library):
        if name not in reached:
            try:
                tree = expand(library, name)
            except FileError:
                # The tree contains itself, which was reported already, or is too large to be run.
                return
            nodes = list(tree.root.walk())
            reached |= {name, *(n.type for n in nodes if n.category is Category.SUBTREE)}
            entries = _Entries(library, findings, tree.constants)
            for node in nodes:
                entries.check(node)


def _tops(library: Library) -> Iterator[str]:
    """Yield the main tree, then trees that no other tree contains, then the rest."""
    if library.main_tree in library.trees:
        yield str(library.main_tree)
    elements = [source.element for source in library.own_trees.values()]
    inner = {e.get("ID") for top in elements for e in top.walk() if e.tag == SUBTREE}
    yield from sorted(library.own_trees, key=lambda name: name in inner)


@dataclass(frozen=True, slots=True)
class _Typed:
    """The type of an entry, and where it comes from."""

    type: str
    origin: str


class _Entries:
    """The typed entries of one tree; its nodes must be checked in preorder."""

    def __init__(self, library: Library, findings: Findings, constants: dict[str, str]) -> None:
        self.library = library
        self.findings = findings
        self.constants = constants
        self.typed: dict[str, _Typed] = {}
        for entry, text in constants.items():
            value = constant_value(text)
            kind = "" if isinstance(value, str) else type_of_value(value)
            self.typed[entry] = _Typed(kind, f"the value {text!r} of a SubTree")

    def rule(self, node: ExpandedNode, message: str) -> None:
        self.findings.rule(node.file, node.line, node.path, message)

    def check(self, node: ExpandedNode) -> None:
        model = self.library.model(node.type)
        if node.category is Category.SUBTREE or model is None:
            return
        typed: list[tuple[str, str, Port]] = []
        for name, value in ports(node.element).items():
            key, port = pointer(value, name), model.ports.get(name)
            if key is None or port is None:
                continue
            if port.type == SCRIPT:
                self.check_script(node, name, key)
            kind = entry_type(node.type, port)
            if kind is not None:
                typed.append((kind, key, port))
        # The order of one node's ports in BehaviorTree.CPP is unspecified: assume the worst one.
        for kind, key, port in sorted(typed, key=lambda each: _LAST.get(each[0], 0)):
            self.declare(node, kind, key, port)

    def declare(self, node: ExpandedNode, kind: str, key: str, port: Port) -> None:
        """Record that a port names an entry; check its type against that of the entry."""
        origin = f"port {port.name!r} of {node.name} in line {node.line}"
        before = self.typed.setdefault(node.scope.entry(key), _Typed(kind, origin))
        if kind in _FREE or before.type in (*_FREE, TEXT) or is_one_type(kind, before.type):
            return
        # The C++ program may have registered one class as the base of the other.
        is_pointer = kind.startswith("shared_ptr<") and before.type.startswith("shared_ptr<")
        if not (is_pointer and port.direction is Direction.INPUT):
            message = f"port {port.name!r} is of type {kind}, but its entry {key!r} is of type "
            self.rule(node, f"{message}{before.type}, by {before.origin}")

    def check_script(self, node: ExpandedNode, name: str, key: str) -> None:
        """Check a script that is in an entry: it must be there when the tree is created."""
        text = self.constants.get(node.scope.entry(key))
        if text is None:
            message = "BehaviorTree.CPP reads a script when it makes the tree"
            self.rule(node, f"port {name!r}: {message}, and the entry {key!r} has no value then")
        elif problem := script_problem(text):
            self.rule(node, f"port {name!r}: {problem}")
