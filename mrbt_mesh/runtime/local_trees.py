"""Carries out a local task that is a tree: starts and cancels its actions as its ticks say.

It is one task of the event loop, on a virtual clock as well as on a real one, and ticks when
something has happened: an action has ended, a condition of the robot has changed, a time is over.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Container, Mapping
from typing import TypeAlias

import anyio
import anyio.abc

from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.local_run import LocalConditions, LocalRun
from mrbt_mesh.core.bt.tree import Status, Tree
from mrbt_mesh.core.mission.mission import MICRO

# How an action has ended: whether it succeeded, and the robot's local conditions that go with that.
LeafEnd: TypeAlias = tuple[bool, Mapping[str, bool]]
# Carries out an action, by its ground name, to its end.
RunLeaf: TypeAlias = Callable[[str], Awaitable[LeafEnd]]


class LocalTreeRunner:
    """Runs one tree once. `group` is what its actions are started in; `tell` hears the statuses of
    its nodes after each tick.
    """

    def __init__(
        self,
        group: anyio.abc.TaskGroup,
        tree: Tree,
        conditions: LocalConditions,
        run_leaf: RunLeaf,
        tell: Callable[[bytes], None],
    ) -> None:
        self._group = group
        self._conditions = conditions
        self._run_leaf = run_leaf
        self._tell = tell
        self._run = LocalRun(tree, conditions)
        self._result = Status.RUNNING
        # By activation: actions and Timeouts that have been begun and have not ended.
        self._actions: dict[str, anyio.CancelScope] = {}
        self._timeouts: dict[str, anyio.CancelScope] = {}
        self._happened = anyio.Event()

    async def run(self) -> bool:
        """Whether the tree has succeeded. Cancelled, it stops all its actions before it ends."""
        self._conditions.watchers.append(self._turned)
        try:
            while True:
                self._happened = anyio.Event()
                self._tick()
                if self._result is not Status.RUNNING:
                    return self._result is Status.SUCCESS
                await self._happened.wait()
        finally:
            self._conditions.watchers.remove(self._turned)
            await self._stop()

    def _tick(self) -> None:
        """Once the root has ended, that is the result, whatever happens then."""
        if self._result is Status.RUNNING:
            found = self._run.tick()
            self._result = found.status
            self._tell(found.statuses)
            self._follow(found)

    def _follow(self, found: Evaluation) -> None:
        """Start what is requested, and cancel what is not."""
        requested = {request.activation: request.subject for request in found.requests}
        waiting = {timeout.activation: timeout.timeout_us for timeout in found.timeouts}
        _cancel(self._actions, requested)
        _cancel(self._timeouts, waiting)
        # Nothing is begun while an action is still being stopped: it may need the same hardware.
        is_stopping = any(activation not in requested for activation in self._actions)
        for activation, subject in () if is_stopping else requested.items():
            if activation not in self._actions:
                scope = self._actions[activation] = anyio.CancelScope()
                self._group.start_soon(self._carry_out, activation, subject, scope)
        for activation, timeout_us in waiting.items():
            if activation not in self._timeouts:
                scope = self._timeouts[activation] = anyio.CancelScope()
                self._group.start_soon(self._wait, activation, timeout_us, scope)

    async def _carry_out(self, activation: str, subject: str, scope: anyio.CancelScope) -> None:
        try:
            with scope:
                self._note(activation, *await self._run_leaf(subject))
        finally:
            # Also when the whole process ends, which no scope here keeps from going further.
            del self._actions[activation]
            self._happened.set()

    def _note(self, activation: str, success: bool, conditions: Mapping[str, bool]) -> None:
        """The tick in which an action returns comes before what its conditions change."""
        if self._result is Status.RUNNING:
            self._result = self._run.returned(activation, success, conditions)
        for name, value in conditions.items():
            self._conditions.set(name, value)

    async def _wait(self, activation: str, timeout_us: int, scope: anyio.CancelScope) -> None:
        try:
            with scope:
                await anyio.sleep(timeout_us / MICRO)
                self._run.expired(activation)
        finally:
            del self._timeouts[activation]
            self._happened.set()

    def _turned(self, name: str) -> None:
        self._run.turned(name)
        self._happened.set()

    async def _stop(self) -> None:
        """Cancel what still runs, in a fixed order, and wait until it has ended."""
        _cancel(self._actions, ())
        _cancel(self._timeouts, ())
        with anyio.CancelScope(shield=True):
            while self._actions or self._timeouts:
                self._happened = anyio.Event()
                await self._happened.wait()


def _cancel(scopes: Mapping[str, anyio.CancelScope], wanted: Container[str]) -> None:
    for activation, scope in scopes.items():
        if activation not in wanted:
            scope.cancel()
