"""BehaviorTree.CPP's control nodes: which children they tick, in which order, and their status.

A control whose children were all skipped returns SKIPPED. As in BehaviorTree.CPP, its own status
stays RUNNING until its parent resets it.
"""

from __future__ import annotations

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
    reset_all,
)
from mrbt_mesh.btcpp.files.builtin_nodes import SWITCHES
from mrbt_mesh.btcpp.scripts.values import read_real


class InOrder(TreeNode):
    """Sequence, Fallback and their Async forms: each tick continues at the child that was running.

    An Async form returns RUNNING after each child that ended in one tick, so that it can be
    halted there.
    """

    __slots__ = ("goes_on", "index", "is_async", "skipped")
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.goes_on = FAILURE if "Fallback" in self.type else SUCCESS
        self.is_async = self.type.startswith("Async")

    def clear(self) -> None:
        self.index = self.skipped = 0

    def tick(self) -> NodeStatus:
        if self.is_anew:
            self.skipped = 0
        self.status = RUNNING
        children, count = self.children, len(self.children)
        while self.index < count:
            child = children[self.index]
            was_idle = child.status is IDLE
            status = child.execute()
            if status is RUNNING:
                return RUNNING
            if status is SKIPPED:
                self.index += 1
                self.skipped += 1
            elif status is self.goes_on:
                self.index += 1
                if self.is_async and was_idle and self.yields and self.index < count:
                    self.world.woken_by = self.place
                    return RUNNING
            else:
                return self.stopped(status)
        return self.ended(SKIPPED if self.skipped == count else self.goes_on)

    def stopped(self, status: NodeStatus) -> NodeStatus:
        """End the run because a child returned `status`, which stops it."""
        self.index = 0
        reset_all(self.children)
        return status


class SequenceWithMemory(InOrder):
    """A Sequence that keeps its place when a child fails, and when it is halted."""

    __slots__ = ()

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.is_async = True

    def halt(self) -> None:
        reset_all(self.children)
        self.status = IDLE

    def stopped(self, status: NodeStatus) -> NodeStatus:
        reset_all(self.children[self.index :])
        return status


class Reactive(TreeNode):
    """ReactiveSequence and ReactiveFallback: every tick starts again at the first child."""

    __slots__ = ("goes_on",)
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.goes_on = SUCCESS if self.type == "ReactiveSequence" else FAILURE

    def tick(self) -> NodeStatus:
        all_skipped = True
        self.status = RUNNING
        children, goes_on = self.children, self.goes_on
        for child in children:
            status = child.execute()
            if status is goes_on:
                all_skipped = False
            elif status is RUNNING:
                for other in children:
                    if other is not child and other.status is not IDLE:
                        reset(other)
                return RUNNING
            elif status is SKIPPED:
                reset(child)
            else:
                return self.ended(status)
        return self.ended(SKIPPED if all_skipped else goes_on)


class ParallelNode(TreeNode):
    """Ticks all unfinished children at every tick, until enough have succeeded or failed."""

    __slots__ = ("done", "failures", "successes")
    CHILDREN: ClassVar[tuple[int, int | None]] = (1, None)

    def clear(self) -> None:
        self.done: set[int] = set()
        self.successes = self.failures = 0

    def threshold(self, port: str) -> tuple[int, int]:
        """Return a threshold as given and as a count; a negative one counts back from all children.

        Raises TickError if it is above the number of children.
        """
        given, count = int(self.input(port, "int")), len(self.children)
        counted = given if given >= 0 else max(count + given + 1, 0)
        if counted > count:
            raise TickError(
                f"{self.place}: {port}={given} is above the number of children, {count}"
            )
        return given, counted

    def tick(self) -> NodeStatus:
        given, needed = self.threshold("success_count")
        _, allowed = self.threshold("failure_count")
        self.status = RUNNING
        skipped, count = 0, len(self.children)
        for index in range(count):
            skipped += self.tick_child(index)
            enough = self.successes >= needed
            if enough or (given < 0 and self.successes + skipped >= needed):
                return self.ended(SUCCESS)
            if count - self.failures < needed or self.failures == allowed:
                return self.ended(FAILURE)
        return SKIPPED if skipped == count else RUNNING

    def tick_child(self, index: int) -> bool:
        """Tick a child unless it has ended. Returns whether it was skipped."""
        if index in self.done:
            return False
        status = self.children[index].execute()
        if status is SUCCESS or status is FAILURE:
            self.done.add(index)
            self.successes += status is SUCCESS
            self.failures += status is FAILURE
        return status is SKIPPED


class ParallelAll(ParallelNode):
    """Runs all children to completion; fails if `max_failures` or more of them failed."""

    __slots__ = ()

    def tick(self) -> NodeStatus:
        _, allowed = self.threshold("max_failures")
        self.status = RUNNING
        count = len(self.children)
        skipped = sum(map(self.tick_child, range(count)))
        if skipped == count:
            return SKIPPED
        if skipped + len(self.done) < count:
            return RUNNING
        return self.ended(FAILURE if self.failures >= allowed else SUCCESS)


class IfThenElse(TreeNode):
    """The first child decides once which other child is run to completion."""

    __slots__ = ("index",)
    CHILDREN: ClassVar[tuple[int, int | None]] = (2, 3)

    def clear(self) -> None:
        self.index = 0

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        if self.index == 0:
            status = self.children[0].execute()
            if status is RUNNING:
                return RUNNING
            if status is SKIPPED:
                raise TickError(f"{self.place}: the condition was skipped")
            if status is FAILURE and len(self.children) == 2:
                if not self.world.exact:
                    reset_all(self.children)
                return FAILURE
            self.index = 1 if status is SUCCESS else 2
        status = self.children[self.index].execute()
        return status if status is RUNNING else self.ended(status)


class WhileDoElse(TreeNode):
    """The first child decides at every tick which other child is ticked."""

    __slots__ = ()
    CHILDREN: ClassVar[tuple[int, int | None]] = (2, 3)

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        condition, *branches = self.children
        decided = condition.execute()
        if decided is RUNNING:
            return RUNNING
        if decided is SKIPPED:
            raise TickError(f"{self.place}: the condition was skipped")
        chosen = 0 if decided is SUCCESS else 1
        if 1 - chosen < len(branches):
            reset(branches[1 - chosen])
        status = branches[chosen].execute() if chosen < len(branches) else FAILURE
        return status if status is RUNNING else self.ended(status)


class Switch(TreeNode):
    """Ticks the child whose case equals the variable, else the last child."""

    __slots__ = ("chosen",)

    def clear(self) -> None:
        self.chosen = -1

    def _text(self, port: str) -> str | None:
        try:
            return str(self.input(port))
        except TickError:
            return None

    def _choice(self) -> int:
        cases = len(self.children) - 1
        variable = self._text("variable")
        if variable is not None:
            for index in range(cases):
                case = self._text(f"case_{index + 1}")
                if case is not None and self._same(variable, case):
                    return index
        return cases

    def _same(self, left: str, right: str) -> bool:
        if left == right:
            return True
        enums = self.world.enums
        first, second = (read_real(str(enums.get(text, text))) for text in (left, right))
        if first is None or second is None:
            return False
        return abs(first - second) <= 2.0**-23

    def tick(self) -> NodeStatus:
        chosen = self._choice()
        if self.chosen not in (-1, chosen):
            reset(self.children[self.chosen])
        status = self.children[chosen].execute()
        self.chosen = chosen if status is RUNNING else -1
        return status if status in (RUNNING, SKIPPED) else self.ended(status)


class TryCatch(TreeNode):
    """Runs all children but the last in order. If one fails, runs the last and returns FAILURE."""

    __slots__ = ("in_catch", "index", "skipped")
    CHILDREN: ClassVar[tuple[int, int | None]] = (2, None)

    def clear(self) -> None:
        self.index = self.skipped = 0
        self.in_catch = False

    def halt(self) -> None:
        if not self.in_catch and self.status is RUNNING and self.input("catch_on_halt", "bool"):
            reset_all(self.children[:-1])
            if self.children[-1].execute() is RUNNING:
                reset(self.children[-1])
        super().halt()

    def tick(self) -> NodeStatus:
        if self.is_anew:
            self.skipped = 0
            self.in_catch = False
        self.status = RUNNING
        tried = len(self.children) - 1
        while not self.in_catch and self.index < tried:
            status = self.children[self.index].execute()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                reset_all(self.children)
                self.index = 0
                self.in_catch = True
            else:
                self.index += 1
                self.skipped += status is SKIPPED
        if self.in_catch:
            if self.children[-1].execute() is RUNNING:
                return RUNNING
            self.index, self.in_catch = 0, False
            reset_all(self.children)
            return FAILURE
        return self.ended(SKIPPED if self.skipped == tried else SUCCESS)


CONTROLS: dict[str, type[TreeNode]] = {
    "Sequence": InOrder,
    "AsyncSequence": InOrder,
    "SequenceWithMemory": SequenceWithMemory,
    "Fallback": InOrder,
    "AsyncFallback": InOrder,
    "ReactiveSequence": Reactive,
    "ReactiveFallback": Reactive,
    "Parallel": ParallelNode,
    "ParallelAll": ParallelAll,
    "IfThenElse": IfThenElse,
    "WhileDoElse": WhileDoElse,
    "TryCatch": TryCatch,
    **dict.fromkeys(SWITCHES, Switch),
}
