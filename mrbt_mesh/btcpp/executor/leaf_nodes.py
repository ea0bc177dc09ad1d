"""Nodes that call a robot's own functions."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from mrbt_mesh.btcpp.executor.leaves import InOut, Leaf, Out
from mrbt_mesh.btcpp.executor.node import (
    FAILURE,
    IDLE,
    RUNNING,
    SUCCESS,
    CancelLeaf,
    NodeStatus,
    StartLeaf,
    TickError,
    TreeNode,
)
from mrbt_mesh.btcpp.files.document import Category, pointer
from mrbt_mesh.errors import TaskFailedError

# How often the coroutine of a condition may yield to other tasks.
MAX_YIELDS = 100


class LeafNode(TreeNode):
    """Base class of actions and conditions: a registered function and its arguments.

    `reason` is the function's message when it last failed.
    """

    __slots__ = ("leaf", "reason")
    leaf: Leaf

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.reason = ""

    def arguments(self) -> dict[str, Any]:
        """Return the input ports by name. Raises TickError if one is missing or of a wrong type."""
        found: dict[str, Any] = {}
        for name, port in self.leaf.ports.items():
            may_be_missing = port.is_optional or port.writes
            if self.world.exact and port.has_value and name in self.ports:
                # In BehaviorTree.CPP a default replaces an omitted port, not a missing entry.
                may_be_missing = False
            is_left_out = port.writes and self.ports.get(name) == ""
            if port.reads and not (may_be_missing and (is_left_out or self._has_no_value(name))):
                found[name] = self.input(name, port.type)
        if self.leaf.takes_others:
            for name in self.ports:
                if name not in self.leaf.ports and not self._has_no_value(name):
                    found[name] = self.input(name, "")
        return found

    def _has_no_value(self, port: str) -> bool:
        text = self.ports.get(port, self.defaults.get(port))
        if text is None:
            return True
        key = pointer(text, port)
        return key is not None and self.board.read(key) is None

    def _has_entry(self, port: str) -> bool:
        """Return whether an output has an entry to write; a port's default may be a value."""
        text = self.ports.get(port, self.defaults.get(port, ""))
        return port in self.ports or pointer(text, port) is not None

    def call(self, inputs: Mapping[str, Any], write: Any) -> Any:
        """Call the function; its output ports call `write(port, value)`."""
        arguments = dict(inputs)
        for name, port in self.leaf.ports.items():
            if port.writes and (self.ports.get(name) or not port.is_optional):

                def write_port(value: Any, name: str = name) -> None:
                    if self._has_entry(name):
                        write(name, value)

                value = arguments.get(name)
                arguments[name] = InOut(write_port, value) if port.reads else Out(write_port)
        for name, kind in self.leaf.given.items():
            arguments[name] = self.world.given[kind]
        first = (self.type,) if self.leaf.takes_type else ()
        return self.leaf.function(*first, **arguments)


class SyncLeaf(LeafNode):
    """A condition, or an action that ends within the tick: calls its function at every tick.

    An action returns RUNNING while a cancelled one has not stopped: both may move the robot.
    """

    __slots__ = ()

    def tick(self) -> NodeStatus:
        self.world.count_leaf(self.place)
        if self.world.stopping and self.leaf.category is Category.ACTION:
            return RUNNING
        self.reason = ""
        try:
            result = self.call(self.arguments(), self.output)
            return status_of(_finished(result, self), self)
        except TaskFailedError as failure:
            self.reason = str(failure)
            return FAILURE


class ActionLeaf(LeafNode):
    """An action that takes time: started at its first tick, cancelled when it is halted."""

    __slots__ = ("outcome", "run")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.run = 0
        self.outcome: NodeStatus | None = None

    def tick(self) -> NodeStatus:
        self.world.count_leaf(self.place)
        if self.status is IDLE:
            inputs = self.arguments()
            self.run += 1
            self.outcome = None
            self.reason = ""
            self.world.effects.append(StartLeaf(self.uid, self.run, self.type, inputs))
            return RUNNING
        if self.status is RUNNING:
            return RUNNING if self.outcome is None else self.outcome
        return self.status

    def halt(self) -> None:
        if self.status is RUNNING and self.outcome is None:
            self.world.effects.append(CancelLeaf(self.uid, self.run))
            if self.world.stopping is not None:
                self.world.stopping.add((self.uid, self.run))
        self.outcome = None
        super().halt()


def status_of(result: Any, node: TreeNode) -> NodeStatus:
    """Return the status that a function's result stands for. Raises TickError."""
    if result is None:
        return SUCCESS
    truth = _truth_of(result)
    if truth is not None:
        return SUCCESS if truth else FAILURE
    if isinstance(result, NodeStatus) and result not in (IDLE, RUNNING):
        return result
    raise TickError(
        f"{node.place}: {node.type} returned {result!r:.80}, which is not a status: return None, "
        "True, False or a NodeStatus that ends it"
    )


def _finished(result: Any, node: TreeNode) -> Any:
    """Return the result of a coroutine that does not wait. Raises TickError if it waits.

    Yielding to other tasks (`asyncio.sleep(0)`, a free anyio lock) does not count as waiting.
    """
    if not inspect.iscoroutine(result):
        return result
    try:
        for _ in range(MAX_YIELDS):
            if result.send(None) is not None:
                break
    except StopIteration as end:
        return end.value
    finally:
        result.close()
    raise TickError(
        f"{node.place}: the condition {node.type!r} waits; it has to answer at once, what takes "
        "time belongs in an action"
    )


def _truth_of(value: Any) -> bool | None:
    """Return a Python or numpy bool as a bool; None for anything else."""
    kind = type(value)
    is_numpy = kind.__module__ == "numpy" and kind.__name__ in ("bool", "bool_")
    return bool(value) if is_numpy or kind is bool else None
