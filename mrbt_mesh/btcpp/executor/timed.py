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


class Timeout(Decorator):
    """FAILURE if the child is still running after `msec`; it is halted at that moment."""

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
            limit_us = int(self.input("msec", "unsigned int")) * MILLI_US
            self.started = True
            self.child_halted = False
            self.status = RUNNING
            if limit_us > 0:
                self.world.deadlines_us[self.uid] = self.world.now_us + limit_us
        if self.child_halted:
            self.clear()
            return FAILURE
        status = self.tick_child()
        if status is SUCCESS or status is FAILURE:
            self.clear()
        return status


class Delay(Decorator):
    """The child `delay_msec` after the first tick."""

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
            wait_us = int(self.input("delay_msec", "unsigned int")) * MILLI_US
            self.started = True
            self.complete = wait_us == 0
            self.status = RUNNING
            if not self.complete:
                self.world.deadlines_us[self.uid] = self.world.now_us + wait_us
        if not self.complete:
            return RUNNING
        status = self.tick_child()
        if status is SUCCESS or status is FAILURE:
            self.started = False
        return status


class Sleep(TreeNode):
    """SUCCESS `msec` after the first tick."""

    __slots__ = ("waits",)

    def clear(self) -> None:
        self.waits = False
        self.world.deadlines_us.pop(self.uid, None)

    def expire(self) -> None:
        self.waits = False

    def tick(self) -> NodeStatus:
        if self.status is IDLE:
            wait_us = int(self.input("msec", "unsigned int")) * MILLI_US
            if wait_us <= 0:
                return SUCCESS
            self.waits = True
            self.world.deadlines_us[self.uid] = self.world.now_us + wait_us
            return RUNNING
        if self.status is RUNNING:
            return RUNNING if self.waits else SUCCESS
        return self.status


TIMED: dict[str, type[TreeNode]] = {"Timeout": Timeout, "Delay": Delay, "Sleep": Sleep}
