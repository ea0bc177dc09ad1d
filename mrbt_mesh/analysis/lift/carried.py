"""What a part of a robot's tree would keep from one round to the next.

A part that is a local task of its own begins with a new blackboard and new nodes each time. That is
the same as in the whole tree only if it writes whatever it reads before it reads it, and if its
nodes forget what was when they begin again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from mrbt_mesh.analysis.team_tree import KINDS
from mrbt_mesh.btcpp.files.builtin_nodes import SWITCHES
from mrbt_mesh.btcpp.files.document import LEAVES, POSTCONDITIONS, PRECONDITIONS, Category
from mrbt_mesh.btcpp.files.entries import access_below, port_access, read_scripts, script_access
from mrbt_mesh.btcpp.files.expand import SCRIPT_PORTS, ExpandedNode
from mrbt_mesh.btcpp.files.library import Library

Entries = frozenset[str]

# Nodes, other than leaves, that begin anew once they have ended or were halted.
_FORGETS = (
    frozenset(KINDS) - {"SequenceWithMemory"}
    | {"ParallelAll", "TryCatch", "Delay", "Precondition", "PipelineSequence", "RecoveryNode"}
    | frozenset(SWITCHES)
)
_REMEMBERING_LEAVES = frozenset({"WasEntryUpdated"})
_IN_ORDER = frozenset({"Sequence", "AsyncSequence", "ReactiveSequence", "PipelineSequence"})
_FALLBACKS = frozenset({"Fallback", "AsyncFallback", "ReactiveFallback"})
_SUCCEEDS_WITH_IT = frozenset({"RetryUntilSuccessful", "Timeout", "Delay", "Precondition"})

_SKIPPING = frozenset({"RunOnce", "SkipUnlessUpdated", "WaitValueUpdate"})
_STATUS_PORTS = ("else", "if_empty")
# They pass the status of one child on, whichever that is.
_CHOOSING = frozenset({"IfThenElse", "WhileDoElse", "TryCatch"})


def carried(nodes: Sequence[ExpandedNode], library: Library) -> str:
    """Why a run of children, one after the other, cannot begin anew; empty if it can."""
    for node in (inner for each in nodes for inner in each.walk()):
        is_leaf = node.category in LEAVES
        remembers = node.type in _REMEMBERING_LEAVES if is_leaf else node.type not in _FORGETS
        if remembers and node.category is not Category.SUBTREE:
            return f"{node.name} may remember how it was left"
    flow = _Flow(library, access_below(nodes, library).writes)
    flow.in_order(nodes, frozenset())
    if flow.early:
        return f"{sorted(flow.early)[0]!r} may be read before it is written"
    return ""


@dataclass
class _Flow:
    """Follows what is certainly written. `early`: entries that may be read before that."""

    library: Library
    own: Entries
    early: set[str] = field(default_factory=set)

    def reads(self, names: Iterable[str], written: Entries) -> None:
        self.early.update((frozenset(names) & self.own) - written)

    def scripts(self, texts: Iterable[str], written: Entries) -> Entries:
        """What is written after these have been run."""
        for script in read_scripts(texts):
            for statement in script.statements:
                one = type(script)((statement,))
                self.reads(one.read, written)
                written |= one.written
        return written

    def in_order(self, nodes: Iterable[ExpandedNode], written: Entries) -> Entries:
        for node in nodes:
            after = self.node(node, written)
            written = written if may_skip(node) else after
        return written

    def node(self, node: ExpandedNode, written: Entries) -> Entries:
        """What is certainly written once the node has succeeded."""
        before = [node.conditions[name] for name in PRECONDITIONS if name in node.conditions]
        self.reads(script_access(before).reads, written)
        after = self.inner(node, written)
        for name in POSTCONDITIONS:
            ended = self.scripts([node.conditions.get(name, "")], after)
            after = ended if name in ("_onSuccess", "_post") else after
        return after

    def inner(self, node: ExpandedNode, written: Entries) -> Entries:
        if node.category in LEAVES:
            return self.leaf(node, written)
        self.reads(port_access(node, self.library).reads, written)
        if node.type in _IN_ORDER:
            return self.in_order(node.children, written)
        if node.type == "IfThenElse" and len(node.children) > 1:
            asked = self.node(node.children[0], written)
            ends = [self.node(node.children[1], asked)]
            ends += [self.node(child, written) for child in node.children[2:]]
            return frozenset.intersection(*ends)
        ends = [self.node(child, written) for child in node.children]
        if not ends or any(map(may_skip, node.children)):
            return written
        is_subtree = node.category is Category.SUBTREE
        if node.type in _FALLBACKS or node.type in _SUCCEEDS_WITH_IT or is_subtree:
            return frozenset.intersection(*ends)
        return written

    def leaf(self, node: ExpandedNode, written: Entries) -> Entries:
        if node.type in SCRIPT_PORTS:
            return self.scripts([node.ports.get(SCRIPT_PORTS[node.type], "")], written)
        found = port_access(node, self.library)
        self.reads(found.reads, written)
        return written if node.type == "UnsetBlackboard" else written | found.writes


def may_skip(node: ExpandedNode) -> bool:
    """Whether a node may end as SKIPPED; actions of a program never do."""
    if "_skipIf" in node.conditions or "_while" in node.conditions or node.type in _SKIPPING:
        return True
    if any("SKIPPED" in node.ports.get(port, "") for port in _STATUS_PORTS):
        return True
    if not node.children:
        return node.category is Category.SUBTREE
    if node.type in _CHOOSING or node.type in SWITCHES:
        return any(map(may_skip, node.children))
    return all(map(may_skip, node.children))
