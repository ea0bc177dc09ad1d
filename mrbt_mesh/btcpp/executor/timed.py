"""Nodes that wait: Timeout, Delay, Sleep. Their deadlines are kept in the tree's world."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.btcpp.executor.decorators import Decorator
from mrbt_mesh.btcpp.executor.node import (
    FAILURE,
    IDLE,
    RUNNING,
    SUCCESS,
    NodeStatus,
    TreeNode,
    reset,
)

MILLI_US = 1_000


def _wait(node: TreeNode, port: str) -> bool:
    """Set a deadline from a port in milliseconds. Returns False, and sets none, if it is 0."""
    wait_us = int(node.input(port, "unsigned int")) * MILLI_US
    if wait_us > 0:
        node.world.deadlines_us[node.uid] = node.world.now_us + wait_us
    return wait_us > 0


class Timeout(Decorator):
    """Halts the child and returns FAILURE if it still runs `msec` after its first tick."""

    __slots__ = ("child_halted", "started")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.child_halted = False

    def clear(self) -> None:
        self.started = False
        self.world.deadlines_us.pop(self.uid, None)

    def expire(self) -> None:
        if self.child.status is RUNNING:
            self.child_halted = True
            reset(self.child)

    def tick(self) -> NodeStatus:
        if not self.started:
            _wait(self, "msec")
            self.started = True
            self.child_halted = False
            self.status = RUNNING
        if self.child_halted:
            self.clear()
            return FAILURE
        status = self.tick_child()
        if status is SUCCESS or status is FAILURE:
            self.clear()
        return status


class Delay(Decorator):
    """Ticks the child `delay_msec` after the first tick."""

    __slots__ = ("complete", "started")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.complete = False

    def clear(self) -> None:
        self.started = False
        self.world.deadlines_us.pop(self.uid, None)

    def expire(self) -> None:
        self.complete = True

    def tick(self) -> NodeStatus:
        if not self.started:
            self.complete = not _wait(self, "delay_msec")
            self.started = True
            self.status = RUNNING
        if not self.complete:
            return RUNNING
        status = self.tick_child()
        if status is SUCCESS or status is FAILURE:
            self.started = False
        return status


class Sleep(TreeNode):
    """Returns SUCCESS `msec` after the first tick."""

    __slots__ = ("waits",)

    def clear(self) -> None:
        self.waits = False
        self.world.deadlines_us.pop(self.uid, None)

    def expire(self) -> None:
        self.waits = False

    def tick(self) -> NodeStatus:
        if self.status is IDLE:
            self.waits = _wait(self, "msec")
            return RUNNING if self.waits else SUCCESS
        if self.status is RUNNING:
            return RUNNING if self.waits else SUCCESS
        return self.status


TIMED: dict[str, type[TreeNode]] = {"Timeout": Timeout, "Delay": Delay, "Sleep": Sleep}
