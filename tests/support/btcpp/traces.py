"""Traces of the real BehaviorTree.CPP 4.10, told again by the executor of a robot's own trees."""

from __future__ import annotations

from collections.abc import Iterator

from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus, TickError
from mrbt_mesh.btcpp.executor.leaf_nodes import ActionLeaf
from mrbt_mesh.errors import FileError
from tests.support.btcpp.conformance import Shown, Trace

MAX_TICKS = 4  # in each step, as measured


class Teller:
    """One trace, ticked as it was measured."""

    def __init__(self, trace: Trace, exact: bool) -> None:
        self.trace = trace
        self.step = 0
        leaves = Leaves()
        for name in trace.actions:
            leaves.action(name)(_action)
        for name in trace.conditions:
            leaves.condition(name)(lambda name=name: self.holds(name))
        text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{trace.xml}</BehaviorTree></root>'
        self.executor = BehaviorTree.from_text(text, None, leaves, exact=exact).executor
        self.actions = [node for node in self.executor.nodes if isinstance(node, ActionLeaf)]
        # By uid: the number of the start, and the step in which it began.
        self.starts: dict[int, tuple[int, int]] = {}
        self.runs: dict[int, int] = {}

    def holds(self, name: str) -> bool:
        return self.trace.conditions[name][self.step] == "1"

    def steps(self) -> Iterator[Shown]:
        count = len(next(iter(self.trace.conditions.values()), "0" * 30))
        for step in range(count):
            self.step = step
            status = NodeStatus.RUNNING
            for _ in range(MAX_TICKS):
                self._end_actions()
                status = self.executor.tick_once(self.step)
                self._note_starts()
                if status is not NodeStatus.RUNNING:
                    break
            running = [node for node in self.actions if node.status is NodeStatus.RUNNING]
            yield status.name, tuple(sorted((n.type, self.starts[n.uid][0]) for n in running))
            if status is not NodeStatus.RUNNING:
                return

    def _end_actions(self) -> None:
        """What was to end in an earlier step and was not asked then does not end by that."""
        for node in self.actions:
            node.outcome = None
            if node.status is NodeStatus.RUNNING:
                number, began = self.starts[node.uid]
                success = self.trace.end(node.type, number, began, self.step)
                if success is not None:
                    ended = NodeStatus.SUCCESS if success else NodeStatus.FAILURE
                    assert self.executor.ended(node.uid, node.run, ended)

    def _note_starts(self) -> None:
        """One that is halted by the call of tickOnce that began it does not count."""
        self.executor.take_effects()
        for node in self.actions:
            if node.run == self.runs.get(node.uid, 0):
                continue
            self.runs[node.uid] = node.run
            if node.status is NodeStatus.RUNNING:
                number, _ = self.starts.get(node.uid, (0, -1))
                self.starts[node.uid] = (number + 1, self.step)


async def _action() -> None:
    """Never called: the trace says how it ends."""


def told(trace: Trace, exact: bool) -> tuple[tuple[Shown, ...], bool]:
    """What the tree shows in each step, and whether an error ended it."""
    shown: list[Shown] = []
    try:
        for step in Teller(trace, exact).steps():
            shown.append(step)
    except (TickError, FileError):
        return tuple(shown), True
    return tuple(shown), False
