"""Finds the blackboard entries that nodes may read before writing them: values kept from before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, NAV2_NODES
from mrbt_mesh.btcpp.files.document import LEAVES, PRECONDITIONS, Category
from mrbt_mesh.btcpp.files.entries import access, port_access
from mrbt_mesh.btcpp.files.expand import ExpandedNode
from mrbt_mesh.btcpp.files.library import Library

_IN_TURN = frozenset(
    {"Sequence", "AsyncSequence", "SequenceWithMemory", "ReactiveSequence", "PipelineSequence"}
)
_ALTERNATIVES = frozenset({"Fallback", "AsyncFallback", "ReactiveFallback"})
# These succeed only if their first child has succeeded.
_AS_THE_FIRST = frozenset(
    {"RetryUntilSuccessful", "Repeat", "Timeout", "Delay"}
    | {"RateController", "RecoveryNode", "GoalUpdater"}
)
_WRITERS = frozenset({"SetBlackboard", "Script"})

_NOTHING: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class EntryFlow:
    """Data flow of a node.

    `kept`: entries that may be read before they are written. `written`: entries that are certainly
    written once the node has succeeded; a success counts as writing all output ports.
    """

    kept: frozenset[str]
    written: frozenset[str]


def entry_flow(node: ExpandedNode, library: Library, known: frozenset[str] = _NOTHING) -> EntryFlow:
    """Return the flow of a node and its descendants; the entries `known` were written before."""
    own = access(node, library)
    kept = own.reads - known
    ports = port_access(node, library)
    surely = ports.writes - ports.reads
    if node.category in LEAVES:
        is_sure = node.type not in BUILTIN or node.type in _WRITERS
        written = surely if is_sure else _NOTHING
    else:
        if node.type in BUILTIN or node.type in NAV2_NODES:
            known |= surely  # The node writes them before it ticks its child.
        below = _of_children(node, library, known)
        kept, written = kept | below.kept, below.written
    # With a pre-condition it may have succeeded, or been skipped, without doing anything.
    is_skippable = any(name in node.conditions for name in PRECONDITIONS)
    return EntryFlow(kept, _NOTHING if is_skippable else written)


def flow_in_turn(
    nodes: Sequence[ExpandedNode], library: Library, known: frozenset[str] = _NOTHING
) -> EntryFlow:
    """Return the flow of nodes run in order, each after the previous ones have succeeded."""
    kept, written = _NOTHING, _NOTHING
    for node in nodes:
        found = entry_flow(node, library, known | written)
        kept, written = kept | found.kept, written | found.written
    return EntryFlow(kept, written)


def _of_children(node: ExpandedNode, library: Library, known: frozenset[str]) -> EntryFlow:
    if node.category is Category.SUBTREE or node.type in _IN_TURN:
        return flow_in_turn(node.children, library, known)
    if node.type == "IfThenElse":
        asked = entry_flow(node.children[0], library, known)
        first = entry_flow(node.children[1], library, known | asked.written)
        rest = [entry_flow(child, library, known) for child in node.children[2:]]
        kept = asked.kept.union(first.kept, *(each.kept for each in rest))
        written = (asked.written | first.written) if rest else _NOTHING
        return EntryFlow(kept, written.intersection(*(each.written for each in rest)))
    found = [entry_flow(child, library, known) for child in node.children]
    kept = _NOTHING.union(*(each.kept for each in found))
    written = _NOTHING
    if found and node.type in _ALTERNATIVES:
        written = found[0].written.intersection(*(each.written for each in found))
    elif found and node.type in _AS_THE_FIRST:
        written = found[0].written
    return EntryFlow(kept, written)
