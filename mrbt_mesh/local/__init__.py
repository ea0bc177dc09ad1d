"""A robot's own behavior tree: BehaviorTree.CPP 4 files run by Python functions, without a team.

`node`, `controls`, `decorators`, `timed`, `nav2`, `builtin_leaves`, `leaf_nodes`: what each node
does in a tick. `blackboard`, `leaves`: what they read, write and call. `builder` makes them of a
file, `engine` ticks them without waiting for anything, `runner` does it in an event loop, `tree`
is what programs use.
"""

from mrbt_mesh.errors import TaskFailedError
from mrbt_mesh.local.blackboard import Blackboard, BlackboardError
from mrbt_mesh.local.leaves import InOut, LeafError, Leaves, Out
from mrbt_mesh.local.node import NodeStatus, TickError, TreeNode
from mrbt_mesh.local.tree import BehaviorTree, NodeView

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
