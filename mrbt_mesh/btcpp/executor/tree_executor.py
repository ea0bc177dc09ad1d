"""Ticks a tree: time and outcomes in, effects out. It never waits and never reads a clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mrbt_mesh.btcpp.executor.blackboard import Blackboard, BlackboardError
from mrbt_mesh.btcpp.executor.controls import InOrder
from mrbt_mesh.btcpp.executor.leaf_nodes import ActionLeaf, LeafNode
from mrbt_mesh.btcpp.executor.node import (
    COMPLETED,
    IDLE,
    RUNNING,
    Effect,
    NodePlace,
    NodeStatus,
    TickError,
    TreeNode,
    TreeWorld,
    reset,
)


class TreeExecutor:
    """Executor of one tree.

        status = executor.tick(now_us)            # Tree::tickExactlyOnce
        for effect in executor.take_effects():    # start and cancel actions
            ...
        executor.ended(uid, run, NodeStatus.SUCCESS)  # and tick again

    `nodes` are all nodes in preorder, with uids from 1.
    """

    def __init__(self, nodes: Sequence[TreeNode], world: TreeWorld, blackboard: Blackboard) -> None:
        self.nodes = tuple(nodes)
        self.blackboard = blackboard
        self.status = IDLE
        self._world = world

    @property
    def root(self) -> TreeNode:
        """The root node."""
        return self.nodes[0]

    @property
    def woken(self) -> bool:
        """True if a node asks to be ticked again at once."""
        return self._world.woken_by is not None

    @property
    def woken_by(self) -> NodePlace | None:
        """The place of the node that asks to be ticked again at once."""
        return self._world.woken_by

    @property
    def next_deadline_us(self) -> int | None:
        """The earliest deadline of a waiting node; None if there is none."""
        return min(self._world.deadlines_us.values(), default=None)

    def tick(self, now_us: int) -> NodeStatus:
        """Tick the tree exactly once; a completed root is idle afterwards. Raises TickError."""
        self._world.leaves = 0
        for name, source in self._world.entries.items():
            self._take_in(name, source())
        return self._tick(now_us)

    def tick_once(self, now_us: int) -> NodeStatus:
        """Tick the tree until no node asks to be ticked again at once (Tree::tickOnce)."""
        status = self.tick(now_us)
        while status is RUNNING and self.woken:
            status = self._tick(now_us)
        return status

    def _tick(self, now_us: int) -> NodeStatus:
        world = self._world
        world.now_us = now_us
        world.woken_by = None
        if world.deadlines_us:
            self._expire(now_us)
        world.tick += 1
        status = self.status = self.root.execute()
        if status in COMPLETED:
            self.root.status = IDLE
        return status

    def _take_in(self, name: str, value: Any) -> None:
        """Set an entry to the program's value; an equal value does not count as a write."""
        if value is None or value == self.blackboard.read(name):
            return
        try:
            self.blackboard.put(name, value)
        except BlackboardError as error:
            raise TickError(f"an entry of the program: {error}") from None

    def _expire(self, now_us: int) -> None:
        due = sorted((at, uid) for uid, at in self._world.deadlines_us.items() if at <= now_us)
        for _, uid in due:
            if self._world.deadlines_us.pop(uid, None) is not None:
                self.nodes[uid - 1].expire()

    def halt(self) -> None:
        """Halt the tree: cancel running actions and run the `_onHalted` scripts.

        BehaviorTree.CPP, and so an exact tree, runs `_onHalted` of idle nodes as well.
        """
        if self._world.exact:
            self.root.halt_node()
            for node in self.nodes:
                node.halt_node()
        reset(self.root)
        self.status = IDLE

    def take_effects(self) -> list[Effect]:
        """Return the effects since the last call, in order."""
        effects, self._world.effects = self._world.effects, []
        return effects

    def ended(self, uid: int, run: int, status: NodeStatus, reason: str = "") -> bool:
        """Record the outcome of an action. Returns False if that run was cancelled meanwhile."""
        node = self.nodes[uid - 1]
        if not isinstance(node, ActionLeaf) or node.run != run or node.status is not RUNNING:
            return False
        node.outcome = status
        node.reason = reason
        return True

    def begin_after(self, uid: int) -> None:
        """Make the next run start after this node. Its ancestors must be Sequences and SubTrees."""
        node = self.root
        while node.uid != uid:
            position = max(n for n, child in enumerate(node.children) if child.uid <= uid)
            child = node.children[position]
            if isinstance(node, InOrder):
                node.index = position + 1 if child.uid == uid else position
            node = child

    def await_stops(self) -> None:
        """From now on, synchronous actions wait until cancelled ones are reported by `stopped`."""
        self._world.stopping = set()

    def stopped(self, uid: int, run: int) -> None:
        """Report that an action has stopped after it was cancelled, or has ended."""
        if self._world.stopping:
            self._world.stopping.discard((uid, run))

    def leaf(self, uid: int) -> LeafNode:
        """Return the leaf `uid`, an action or a condition. Raises KeyError for other nodes."""
        node = self.nodes[uid - 1]
        if not isinstance(node, LeafNode):
            raise KeyError(f"node {uid} is not a leaf")
        return node

    def write(self, uid: int, run: int, port: str, value: Any) -> None:
        """Write an output port of an action; does nothing if that run was cancelled."""
        node = self.nodes[uid - 1]
        if isinstance(node, ActionLeaf) and node.run == run and node.status is RUNNING:
            node.output(port, value)

    def statuses(self) -> bytes:
        """Return each node's status after the last tick, one byte per node, in preorder.

        A node that was ticked has the status it returned, any other the one it has kept.
        """
        tick = self._world.tick
        return bytes(node.shown if node.shown_at == tick else node.status for node in self.nodes)
