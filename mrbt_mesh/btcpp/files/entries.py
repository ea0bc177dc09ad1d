"""Finds the blackboard entries that a node reads and writes: in ports, scripts and its model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from mrbt_mesh.btcpp.files.document import Category, Direction, pointer
from mrbt_mesh.btcpp.files.expand import SCRIPT_PORTS, ExpandedNode
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.parser import parse
from mrbt_mesh.btcpp.scripts.script import Script, ScriptError

# Ports that hold the name of an entry instead of a pointer to it.
NAME_PORTS = {"SetBlackboard": "output_key", "UnsetBlackboard": "key"}


@dataclass(frozen=True, slots=True)
class EntryAccess:
    """Entries of the expanded tree's blackboard that are read and written.

    `writes_any`: it also writes an entry whose name is only known at run time.
    """

    reads: frozenset[str] = frozenset()
    writes: frozenset[str] = frozenset()
    writes_any: bool = False

    def __or__(self, other: EntryAccess) -> EntryAccess:
        return EntryAccess(
            self.reads | other.reads,
            self.writes | other.writes,
            self.writes_any or other.writes_any,
        )

    @property
    def entries(self) -> frozenset[str]:
        """All entries, read or written."""
        return self.reads | self.writes


def port_access(node: ExpandedNode, library: Library) -> EntryAccess:
    """Return the entries used by a node's ports and script ports, without pre-/post-conditions.

    A node without a model may read and write all entries that its ports point to. The ports of a
    SubTree count where its inner nodes use them.
    """
    if node.category is Category.SUBTREE:
        return EntryAccess()
    reads: set[str] = set()
    writes: set[str] = set()
    for name, key in _pointers(node, library):
        direction = port_direction(node, name, library)
        if direction is not Direction.OUTPUT:
            reads.add(key)
        if direction is not Direction.INPUT:
            writes.add(key)
    named = node.ports.get(NAME_PORTS.get(node.type, ""), "")
    is_dynamic = pointer(named) is not None
    if named and not is_dynamic:
        writes.add(node.scope.entry(named))
    found = EntryAccess(frozenset(reads), frozenset(writes), is_dynamic)
    return found | script_access([node.ports.get(SCRIPT_PORTS.get(node.type, ""), "")])


def access(node: ExpandedNode, library: Library) -> EntryAccess:
    """Return the entries that one node itself uses, including its pre- and post-conditions."""
    return port_access(node, library) | script_access(node.conditions.values())


def access_below(nodes: Iterable[ExpandedNode], library: Library) -> EntryAccess:
    """Return the entries that nodes and their descendants use."""
    found = EntryAccess()
    for node in nodes:
        for inner in node.walk():
            found |= access(inner, library)
    return found


def script_access(texts: Iterable[str]) -> EntryAccess:
    """Return the names in scripts. An enum's name looks like an entry that is never written."""
    found = EntryAccess()
    for script in read_scripts(texts):
        found |= EntryAccess(script.read, script.written)
    return found


def read_scripts(texts: Iterable[str]) -> Iterator[Script]:
    """Yield the scripts that can be parsed."""
    for text in filter(None, texts):
        try:
            yield parse(text)
        except ScriptError:
            continue


def _pointers(node: ExpandedNode, library: Library) -> Iterator[tuple[str, str]]:
    """Yield ports that point to entries, with the entries; a model's defaults are included."""
    for name, value in node.ports.items():
        key = pointer(value, name)
        if key is not None:
            yield name, key
    model = library.model(node.type)
    for port in model.ports.values() if model else ():
        key = pointer(port.default or "", port.name)
        if key is not None and port.name not in node.ports:
            yield port.name, node.scope.entry(key)


def port_direction(node: ExpandedNode, name: str, library: Library) -> Direction:
    """Return whether a node reads or writes a port's entry; both if the port is unknown."""
    model = library.model(node.type)
    port = model.ports.get(name) if model else None
    return Direction.INOUT if port is None else port.direction
