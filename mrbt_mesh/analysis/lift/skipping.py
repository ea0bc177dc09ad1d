"""Which nodes of a BehaviorTree.CPP tree may be SKIPPED, a status that no outcome has."""

from __future__ import annotations

from mrbt_mesh.btcpp.files.builtin_nodes import SWITCHES
from mrbt_mesh.btcpp.files.document import Category
from mrbt_mesh.btcpp.files.expand import ExpandedNode

_SKIPPING = frozenset({"RunOnce", "SkipUnlessUpdated", "WaitValueUpdate"})
_STATUS_PORTS = ("else", "if_empty")
# They pass the status of one child on, whichever that is.
_CHOOSING = frozenset({"IfThenElse", "WhileDoElse", "TryCatch"})


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
