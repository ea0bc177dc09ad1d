"""BehaviorTree.CPP's decorators: nodes with a single child."""

from __future__ import annotations

import json
from collections import deque
from typing import Any, ClassVar

from mrbt_mesh.btcpp.executor.node import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    NodeStatus,
    TickError,
    TreeNode,
    reset,
)
from mrbt_mesh.btcpp.files.builtin_nodes import LOOP_ITEMS, TEXT
from mrbt_mesh.btcpp.files.document import pointer
from mrbt_mesh.btcpp.scripts.parser import parse
from mrbt_mesh.btcpp.scripts.values import ValueTypeError, read_text, split_items


class Decorator(TreeNode):
    """Base class of nodes with one child, which is reset once it has completed."""

    __slots__ = ()
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, 1)

    @property
    def child(self) -> TreeNode:
        return self.children[0]

    def tick_child(self) -> NodeStatus:
        """Tick the child; it is IDLE again once it has completed."""
        child = self.children[0]
        status = child.execute()
        if status is SUCCESS or status is FAILURE:
            reset(child)
        return status


class Mapped(Decorator):
    """Inverter, ForceSuccess and ForceFailure: map the status of a completed child to another."""

    __slots__ = ("on_failure", "on_success")
    RESULTS: ClassVar[dict[str, tuple[NodeStatus, NodeStatus]]] = {
        "Inverter": (FAILURE, SUCCESS),
        "ForceSuccess": (SUCCESS, SUCCESS),
        "ForceFailure": (FAILURE, FAILURE),
    }

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.on_success, self.on_failure = self.RESULTS[self.type]

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        status = self.tick_child()
        if status is SUCCESS:
            return self.on_success
        return self.on_failure if status is FAILURE else status


class Again(Decorator):
    """RetryUntilSuccessful and Repeat. The count is kept when the child is skipped.

    Between two attempts of a child that ended in one tick it returns RUNNING and asks to be ticked
    again at once, so that it can be halted there.
    """

    __slots__ = ("count", "goes_on", "limit_port")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        is_retry = self.type == "RetryUntilSuccessful"
        self.goes_on = FAILURE if is_retry else SUCCESS
        self.limit_port = "num_attempts" if is_retry else "num_cycles"

    def clear(self) -> None:
        self.count = 0

    def _limit(self, before: int) -> int:
        """Return the current number of attempts, or `before` if it can no longer be read."""
        try:
            return int(self.input(self.limit_port, "int"))
        except TickError:
            return before

    def tick(self) -> NodeStatus:
        limit = int(self.input(self.limit_port, "int"))
        self.status = RUNNING
        while limit == -1 or self.count < limit:
            was_idle = self.child.status is IDLE
            status = self.tick_child()
            if status is RUNNING:
                return status
            if status is SKIPPED:
                # A child that is a control with all children skipped still has status RUNNING.
                reset(self.child)
                return status
            if status is not self.goes_on:
                self.count = 0
                return status
            self.count += 1
            if self.goes_on is FAILURE:
                # As in BehaviorTree.CPP: the child may have changed the number.
                limit = self._limit(limit)
            if self.yields and was_idle and (limit == -1 or self.count < limit):
                self.world.woken_by = self.place
                return RUNNING
        self.count = 0
        return self.goes_on


class KeepRunningUntilFailure(Decorator):
    """Returns RUNNING until the child fails, then FAILURE."""

    __slots__ = ()

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        return FAILURE if self.tick_child() is FAILURE else RUNNING


class RunOnce(Decorator):
    """Runs the child once in the life of the tree; then returns SKIPPED, or the same status."""

    __slots__ = ("answer",)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.answer = IDLE

    def tick(self) -> NodeStatus:
        if self.answer is not IDLE:
            return SKIPPED if self._then_skips() else self.answer
        self.status = RUNNING
        status = self.tick_child()
        if status is SUCCESS or status is FAILURE:
            self.answer = status
        return status

    def _then_skips(self) -> bool:
        """Return the port `then_skip`, or True if it cannot be read."""
        try:
            return bool(self.input("then_skip", "bool"))
        except TickError:
            return True


class Precondition(Decorator):
    """Ticks the child if a script holds before it starts; else returns the status `else`.

    In an exact tree, as in BehaviorTree.CPP, a child that is halted or skipped counts as started:
    the script is not checked before the child is ticked again.
    """

    __slots__ = ("goes_on", "texts")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.texts: dict[str, Any] = {}
        self.goes_on = False

    def clear(self) -> None:
        if not self.world.exact:
            self.goes_on = False

    def tick(self) -> NodeStatus:
        otherwise = self.input("else", "BT::NodeStatus")
        text = self.input("if")
        script = self.texts.get(text) or self.texts.setdefault(text, parse(text))
        if not self.goes_on and not self.holds(script):
            return NodeStatus(otherwise)
        status = self.tick_child()
        self.goes_on = status is RUNNING or (self.world.exact and status is SKIPPED)
        return status


class Loop(Decorator):
    """The four Loop decorators: put each item of a queue into `value` and tick the child.

    A queue that is a text or a list is restarted at every start. A `collections.deque` is consumed;
    its owner may add items meanwhile.
    """

    __slots__ = ("constant", "items", "running")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.constant: deque[Any] | None = None
        self.items: deque[Any] | None = None
        self.running = False

    def prepare(self) -> None:
        text = self.ports.get("queue", "")
        if pointer(text, "queue") is None:
            self.constant = self._read(text)

    def _read(self, text: str) -> deque[Any]:
        try:
            if text.startswith("json:"):
                return deque(json.loads(text[5:]))
            kind = LOOP_ITEMS[self.type]
            items = split_items(text)
            if kind != TEXT:
                items = [item.strip() for item in items]
            return deque(read_text(item, kind, self.world.enums) for item in items)
        except (ValueTypeError, ValueError, TypeError) as error:
            raise TickError(f"{self.place}: port 'queue': {error}") from None

    def _queue(self) -> deque[Any]:
        """Return the rest of this run's queue; if the entry is a deque, that very deque."""
        value = self.constant
        if value is None:
            key = self.key("queue")
            value = self.board.read(key)
            if value is None and self.items is None:
                raise TickError(f"{self.place}: port 'queue': the entry {key!r} has no value")
            if isinstance(value, deque):
                return value
        if self.items is None:
            if isinstance(value, str):
                value = self._read(value)
            elif not isinstance(value, list | tuple | deque):
                raise TickError(f"{self.place}: port 'queue': the entry {key!r} is not a list")
            self.items = deque(value)
        return self.items

    def tick(self) -> NodeStatus:
        if self.status is IDLE:
            self.running = False
            self.items = None
        if not self.running:
            items = self._queue()
            if not items:
                return NodeStatus(self.input("if_empty", "BT::NodeStatus"))
            item = items.popleft()
            # As in BehaviorTree.CPP, `value` need not point to an entry.
            if pointer(self.ports.get("value", ""), "value") is not None:
                self.output("value", item)
        self.status = RUNNING
        status = self.tick_child()
        self.running = status is RUNNING
        return FAILURE if status is FAILURE else RUNNING


class Updated(Decorator):
    """SkipUnlessUpdated and WaitValueUpdate: run the child only after a new write of an entry."""

    __slots__ = ("otherwise", "running", "seen")

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.otherwise = SKIPPED if self.type == "SkipUnlessUpdated" else RUNNING
        self.seen = 0

    def clear(self) -> None:
        self.running = False

    def tick(self) -> NodeStatus:
        if not self.running:
            entry = self.board.find(self.key("entry"))
            writes = self.seen if entry is None else entry.writes
            if writes == self.seen:
                return self.otherwise
            self.seen = writes
        status = self.tick_child()
        self.running = status is RUNNING
        return status


class SubTree(Decorator):
    """Runs another tree, which has a blackboard of its own."""

    __slots__ = ()

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        return self.tick_child()


DECORATORS: dict[str, type[TreeNode]] = {
    "Inverter": Mapped,
    "ForceSuccess": Mapped,
    "ForceFailure": Mapped,
    "RetryUntilSuccessful": Again,
    "Repeat": Again,
    "KeepRunningUntilFailure": KeepRunningUntilFailure,
    "RunOnce": RunOnce,
    "Precondition": Precondition,
    "LoopInt": Loop,
    "LoopBool": Loop,
    "LoopDouble": Loop,
    "LoopString": Loop,
    "SkipUnlessUpdated": Updated,
    "WaitValueUpdate": Updated,
    "SubTree": SubTree,
}
