"""Runs a tree in an event loop: ticks it on events and at a fixed rate.

Time is read from the event loop, so a run on a virtual clock takes no real time.
"""

from __future__ import annotations

import asyncio
import inspect
import logging
import math
from collections.abc import Awaitable, Callable
from typing import Any, TypeAlias

import anyio
import anyio.abc
import anyio.lowlevel

from mrbt_mesh.btcpp.executor.leaf_nodes import LeafNode, status_of
from mrbt_mesh.btcpp.executor.node import (
    FAILURE,
    MICRO,
    RUNNING,
    CancelLeaf,
    NodeStatus,
    StartLeaf,
    TickError,
)
from mrbt_mesh.btcpp.executor.tree_executor import TreeExecutor
from mrbt_mesh.driven import Driven, GivenUpError, innermost
from mrbt_mesh.errors import TaskFailedError

Watcher: TypeAlias = Callable[[], None]

# A tree that asks this many times in a row to be ticked again at once is busy polling and would use
# a whole processor. It is then ticked at its rate, or every SLOWED_PERIOD_US if it has no rate.
MAX_AT_ONCE = 10_000
SLOWED_PERIOD_US = 100_000
# A cancelled action that still runs after this time is logged. If the tree itself is ending, the
# action is given up after the same time again.
STOP_LIMIT_S = 5.0
_LOG = logging.getLogger(__name__)


class _Run:
    """One action that was started and has not stopped.

    Its scope is shielded, so it is cancelled in one way only: when the whole tree is cancelled from
    outside, the tree is halted, and that cancels the action.
    """

    def __init__(self, node: LeafNode) -> None:
        self.node = node
        self.scope = anyio.CancelScope(shield=True)
        self.stopped = anyio.Event()
        self.token = f"halted leaf {id(self):x}"
        self.driven: Driven | None = None
        self.task: asyncio.Task[Any] | None = None

    def cancel(self) -> None:
        self.scope.cancel(self.token)

    def drive(self, awaitable: Awaitable[Any]) -> Driven:
        """Wrap the action's awaitable, so that it can be given up."""
        self.task = asyncio.current_task()
        self.driven = Driven(awaitable, self.token)
        return self.driven

    def give_up(self) -> None:
        """End the action even if it shields itself from cancellation."""
        if self.driven is not None and self.task is not None:
            self.driven.is_given_up = True
            self.task.cancel()

    def tell(self) -> None:
        """Log that the action still runs."""
        place = innermost(self.driven.frames() if self.driven is not None else [])
        _LOG.warning(
            "%s: %s still runs %g s after it was halted (%s); no other action begins before it has "
            "ended",
            *(self.node.place, self.node.type, STOP_LIMIT_S, place),
        )


def _is_cancellation(error: BaseException) -> bool:
    """Return True if `error` is a cancellation of this task from outside."""
    is_cancelled = anyio.current_effective_deadline() == -math.inf
    return is_cancelled and isinstance(error, anyio.get_cancelled_exc_class())


class TreeRunner:
    """Runs one executor once, to the end of its tree.

    `clock` returns seconds and must be the clock that `anyio.sleep` uses. `on_tick` is called after
    every tick.
    """

    def __init__(
        self,
        executor: TreeExecutor,
        rate_hz: float,
        clock: Callable[[], float] | None = None,
        on_tick: Watcher | None = None,
    ) -> None:
        self._executor = executor
        executor.await_stops()
        self._period_us = round(MICRO / rate_hz) if rate_hz > 0 else None
        self._clock = clock or anyio.current_time
        self._on_tick = on_tick
        self._runs: dict[tuple[int, int], _Run] = {}
        self._happened = anyio.Event()
        self._error: BaseException | None = None
        # How many times in a row the tree was ticked again at once.
        self._at_once = 0
        self._is_slowed = False

    def wake(self) -> None:
        """Tick the tree soon, regardless of the rate."""
        self._happened.set()

    async def run(self) -> NodeStatus:
        """Run the tree until its root is no longer RUNNING; returns the root's status.

        When cancelled, or ended by an error, it halts the tree and waits until its actions have
        stopped. An action that still runs after twice STOP_LIMIT_S is given up. Raises TickError,
        and any error of a leaf except TaskFailedError.
        """
        result = RUNNING
        try:
            async with anyio.create_task_group() as group:
                try:
                    result = await self._tick_to_the_end(group)
                except BaseException as error:
                    if _is_cancellation(error):
                        raise
                    # A task group would wrap it.
                    self._error = self._error or error
                finally:
                    with anyio.CancelScope(shield=True):
                        await self._stop(is_halted=result is RUNNING)
        except anyio.get_cancelled_exc_class():
            if self._error is None:
                raise
        if self._error is not None:
            raise self._error
        return result

    async def _tick_to_the_end(self, group: anyio.abc.TaskGroup) -> NodeStatus:
        while True:
            self._happened = anyio.Event()
            now_us = round(self._clock() * MICRO)
            status = self._executor.tick(now_us)
            self._follow(group)
            if self._on_tick is not None:
                self._on_tick()
            if status is not RUNNING:
                return status
            await self._wait(now_us)
            if self._error is not None:
                raise self._error

    async def _wait(self, ticked_us: int) -> None:
        """Wait until an event happens, a node's deadline passes, or the next tick is due."""
        ends = [self._executor.next_deadline_us]
        period_us = self._period_us
        if self._executor.woken_by is None:
            self._at_once = 0
        elif self._at_once < MAX_AT_ONCE:
            self._at_once += 1
            await anyio.lowlevel.checkpoint()
            return
        else:
            self._slow_down()
            period_us = period_us or SLOWED_PERIOD_US
        if period_us is not None:
            ends.append(ticked_us + period_us)
        end_us = min((end for end in ends if end is not None), default=None)
        if end_us is None:
            await self._happened.wait()
            return
        wait_s = max(0.0, end_us / MICRO - self._clock())
        with anyio.move_on_after(wait_s):
            await self._happened.wait()

    def _slow_down(self) -> None:
        """Log once which node would otherwise keep the processor busy and stop a virtual clock."""
        if not self._is_slowed:
            self._is_slowed = True
            _LOG.warning(
                "%s: ticked %s times without a pause; from now on it is ticked at the tree's rate",
                self._executor.woken_by,
                f"{MAX_AT_ONCE:,}",
            )

    def _follow(self, group: anyio.abc.TaskGroup) -> None:
        """Cancel and start actions. An action starts once those cancelled before have stopped."""
        for effect in self._executor.take_effects():
            if isinstance(effect, CancelLeaf):
                run = self._runs.get((effect.uid, effect.run))
                if run is None:
                    self._executor.stopped(effect.uid, effect.run)
                else:
                    run.cancel()
                    group.start_soon(self._watch, run)
            else:
                stopping = [run.stopped for run in self._runs.values() if run.scope.cancel_called]
                run = _Run(self._executor.leaf(effect.uid))
                self._runs[effect.uid, effect.run] = run
                group.start_soon(self._carry_out, effect, run, stopping)

    async def _watch(self, run: _Run) -> None:
        """Log the action if it does not stop in time."""
        with anyio.move_on_after(STOP_LIMIT_S):
            await run.stopped.wait()
            return
        run.tell()

    async def _carry_out(self, effect: StartLeaf, run: _Run, before: list[anyio.Event]) -> None:
        try:
            with run.scope:
                for stopped in before:
                    await stopped.wait()
                status, reason = await self._call(effect, run)
                self._executor.ended(effect.uid, effect.run, status, reason)
        except BaseException as error:
            # The cancellation is not the leaf's own: the whole tree is cancelled.
            if _is_cancellation(error):
                raise
            self._error = self._error or error
        finally:
            del self._runs[effect.uid, effect.run]
            self._executor.stopped(effect.uid, effect.run)
            run.stopped.set()
            self._happened.set()

    async def _call(self, effect: StartLeaf, run: _Run) -> tuple[NodeStatus, str]:
        node = run.node

        def write(port: str, value: Any) -> None:
            self._executor.write(effect.uid, effect.run, port, value)
            self._happened.set()

        try:
            result = node.call(effect.inputs, write)
            result = await run.drive(result) if inspect.isawaitable(result) else result
        except TaskFailedError as failure:
            return FAILURE, str(failure)
        except GivenUpError as error:
            remedy = "raise the cancellation again where it is caught"
            raise TickError(f"{node.place}: {node.type} {error} and was ended: {remedy}") from None
        return status_of(result, node), ""

    async def _stop(self, is_halted: bool) -> None:
        """Halt a tree that has not ended, and wait until all started actions have stopped."""
        try:
            if is_halted:
                self._executor.halt()
        except Exception as error:
            self._error = self._error or error
        self._executor.take_effects()
        for run in self._runs.values():
            run.cancel()
        for limit in ("told", "given up"):
            with anyio.move_on_after(STOP_LIMIT_S):
                while self._runs:
                    await next(iter(self._runs.values())).stopped.wait()
            for run in self._runs.values():
                if limit == "told":
                    run.tell()
                else:
                    run.give_up()
        while self._runs:
            await next(iter(self._runs.values())).stopped.wait()
