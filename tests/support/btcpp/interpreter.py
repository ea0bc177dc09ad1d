"""BehaviorTree.CPP's documented tick rules, written down as directly as possible.

Tests compare other evaluators with it, so it favours plainness over speed. It needs no XML:

    world = World()
    root = Node("Sequence", [leaf("RUNNING SUCCESS"), leaf("FAILURE")])
    tick(root, world)     # Status.RUNNING, Tree::tickExactlyOnce
    tick(root, world)     # Status.FAILURE
    halt(root, world)     # Tree::haltTree

Scripts in conditions and ports are functions of the blackboard or texts in BehaviorTree.CPP's
language. `SubTree` is transparent: its child sees the same blackboard.

One thing is as documented and not as built: a control whose children were all skipped is IDLE
afterwards. BehaviorTree.CPP leaves it RUNNING until its parent resets it.
"""

from __future__ import annotations

from tests.support.btcpp import interpreter_controls, interpreter_decorators, interpreter_leaves
from tests.support.btcpp.interpreter_base import (
    COMPLETED,
    FAILURE,
    IDLE,
    MAX_LOOPS,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Blackboard,
    Node,
    Script,
    Status,
    TickError,
    World,
    execute,
    leaf,
    reset,
)

__all__ = [
    "FAILURE",
    "IDLE",
    "RULES",
    "RUNNING",
    "SKIPPED",
    "SUCCESS",
    "Blackboard",
    "Node",
    "Script",
    "Status",
    "TickError",
    "World",
    "halt",
    "leaf",
    "tick",
    "tick_once",
]
# Importing these fills the table of tick rules.
RULES = (interpreter_controls, interpreter_decorators, interpreter_leaves)


def tick(root: Node, world: World) -> Status:
    """Tick a whole tree exactly once; a root that has completed is IDLE afterwards."""
    world.woken = False
    status = execute(root, world)
    if status in COMPLETED:
        root.status = IDLE
    return status


def tick_once(root: Node, world: World) -> Status:
    """Tick a whole tree until nothing asks to be ticked again at once (Tree::tickOnce)."""
    for _ in range(MAX_LOOPS):
        status = tick(root, world)
        if status is not RUNNING or not world.woken:
            return status
    raise TickError("a node asks to be ticked again without end")


def halt(root: Node, world: World) -> None:
    """Halt a whole tree."""
    reset(root, world)
