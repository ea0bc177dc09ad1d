"""BehaviorTree.CPP trees in Python, without a team: read, check and run them.

The reference is BehaviorTree.CPP 4.10, unless another version is named.

    from mrbt_mesh import btcpp

    for finding in btcpp.check("navigate.xml"):
        print(finding)
    status = btcpp.run("navigate.xml", "robot.py", entries={"goal": "dock"})

Within an event loop: `await btcpp.load("navigate.xml", leaves).run()`.

`files` reads, checks and writes trees, `scripts` is their scripting language, `executor` runs them.
This package imports nothing else of mrbt_mesh except `mrbt_mesh.errors` and `mrbt_mesh.driven`.
"""

from mrbt_mesh.btcpp.api import check, load, load_leaves, run
from mrbt_mesh.btcpp.executor.blackboard import Blackboard, BlackboardError
from mrbt_mesh.btcpp.executor.leaves import InOut, LeafError, Leaves, Out
from mrbt_mesh.btcpp.executor.node import NodeStatus, TickError, TreeNode
from mrbt_mesh.btcpp.executor.tree import BehaviorTree, NodeView
from mrbt_mesh.btcpp.files.findings import Finding, Severity
from mrbt_mesh.errors import FileError, TaskFailedError

__all__ = [
    "BehaviorTree",
    "Blackboard",
    "BlackboardError",
    "FileError",
    "Finding",
    "InOut",
    "LeafError",
    "Leaves",
    "NodeStatus",
    "NodeView",
    "Out",
    "Severity",
    "TaskFailedError",
    "TickError",
    "TreeNode",
    "check",
    "load",
    "load_leaves",
    "run",
]
