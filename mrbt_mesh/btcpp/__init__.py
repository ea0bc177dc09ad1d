"""BehaviorTree.CPP trees in Python, without a team: read, check and run them.

`files` reads, checks and writes them, `scripts` is their scripting language, `executor` runs them.
Nothing here imports any other part of mrbt_mesh except `mrbt_mesh.errors`.
"""

from mrbt_mesh.btcpp.executor.blackboard import Blackboard, BlackboardError
from mrbt_mesh.btcpp.executor.leaves import InOut, LeafError, Leaves, Out
from mrbt_mesh.btcpp.executor.node import NodeStatus, TickError, TreeNode
from mrbt_mesh.btcpp.executor.tree import BehaviorTree, NodeView
from mrbt_mesh.errors import TaskFailedError

__all__ = [
    "BehaviorTree",
    "Blackboard",
    "BlackboardError",
    "InOut",
    "LeafError",
    "Leaves",
    "NodeStatus",
    "NodeView",
    "Out",
    "TaskFailedError",
    "TickError",
    "TreeNode",
]
