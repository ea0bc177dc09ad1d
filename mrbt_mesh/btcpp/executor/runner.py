"""Runs a tree in an event loop: ticks it when something has happened and at a rate.

Time comes from the event loop, so that on a virtual clock a run takes no time at all.
"""

from __future__ import annotations

import inspect
import logging
import math
from collections.abc import Callable
from typing import Any, TypeAlias

import anyio
import anyio.abc
import anyio.lowlevel

from mrbt_mesh.btcpp.executor.leaf_nodes import status_of
from mrbt_mesh.btcpp.executor.node import FAILURE, MICRO, RUNNING, CancelLeaf, NodeStatus, StartLeaf
from mrbt_mesh.btcpp.executor.tree_executor import TreeExecutor
from mrbt_mesh.errors import TaskFailedError

Watcher: TypeAlias = Callable[[], None]

# A tree that asks more often in a row to be ticked again at once is ticked at its rate instead: it
# polls, and would use the whole processor. Then every SLOWED_PERIOD_US, if it has no rate.
MAX_AT_ONCE = 10_000
SLOWED_PERIOD_US = 100_000
_LOG = logging.getLogger(__name__)


class _Run:
    """One action that has been begun and has not stopped."""

    def __init__(self) -> None:
        self.scope = anyio.CancelScope()
        self.stopped = anyio.Event()


class TreeRunner:
    """Runs one executor once, to the end of its tree.

    `clock` gives seconds and has to be the one by which `anyio.sleep` waits. `on_tick` is called
    after every tick.
    """

    def __init__(
        self,
        executor: TreeExecutor,
        rate_hz: float,
        clock: Callable[[], float] | None = None,
        on_tick: Watcher | None = None,
    ) -> None:
        self._executor = executor
        self._period_us = round(MICRO / rate_hz) if rate_hz > 0 else None
        self._clock = clock or anyio.current_time
        self._on_tick = on_tick
        self._runs: dict[tuple[int, int], _Run] = {}
        self._happened = anyio.Event()
        self._error: BaseException | None = None
        # How often the tree was ticked again at once, one time after the other.
        self._at_once = 0
        self._is_slowed = False

    def wake(self) -> None:
        """Tick soon, whatever the rate is."""
        self._happened.set()

    async def run(self) -> NodeStatus:
        """The root's status, once it is not RUNNING.

        Cancelled, or ended by an error, it halts the tree and waits until its actions have
        stopped. Raises TickError, and what a leaf raised but for TaskFailedError.
        """
        result = RUNNING
        async with anyio.create_task_group() as group:
            try:
                result = await self._tick_to_the_end(group)
            except BaseException as error:
                if anyio.current_effective_deadline() == -math.inf:
                    raise  # it is cancelled
                # A task group would wrap it.
                self._error = self._error or error
            finally:
                with anyio.CancelScope(shield=True):
                    await self._stop(is_halted=result is RUNNING)
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
        """Until something has happened, a node's time is over, or the next tick is due."""
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
        """Say once which node would otherwise keep the processor busy and the clock standing."""
        if not self._is_slowed:
            self._is_slowed = True
            _LOG.warning(
                "%s: ticked %s times without a pause; from now on it is ticked at the tree's rate",
                self._executor.woken_by,
                f"{MAX_AT_ONCE:,}",
            )

    def _follow(self, group: anyio.abc.TaskGroup) -> None:
        """Cancel and start actions; one begins once those cancelled before it have stopped."""
        for effect in self._executor.take_effects():
            if isinstance(effect, CancelLeaf):
                run = self._runs.get((effect.uid, effect.run))
                if run is not None:
                    run.scope.cancel()
            else:
                stopping = [run.stopped for run in self._runs.values() if run.scope.cancel_called]
                run = self._runs[effect.uid, effect.run] = _Run()
                group.start_soon(self._carry_out, effect, run, stopping)

    async def _carry_out(self, effect: StartLeaf, run: _Run, before: list[anyio.Event]) -> None:
        try:
            with run.scope:
                for stopped in before:
                    await stopped.wait()
                status, reason = await self._call(effect)
                self._executor.ended(effect.uid, effect.run, status, reason)
        except BaseException as error:
            # Not one of the leaf's own making: the whole tree is cancelled.
            if anyio.current_effective_deadline() == -math.inf:
                raise
            self._error = self._error or error
        finally:
            del self._runs[effect.uid, effect.run]
            run.stopped.set()
            self._happened.set()

    async def _call(self, effect: StartLeaf) -> tuple[NodeStatus, str]:
        node = self._executor.leaf(effect.uid)

        def write(port: str, value: Any) -> None:
            self._executor.write(effect.uid, effect.run, port, value)
            self._happened.set()

        try:
            result = node.call(effect.inputs, write)
            result = await result if inspect.isawaitable(result) else result
        except TaskFailedError as failure:
            return FAILURE, str(failure)
        return status_of(result, node), ""

    async def _stop(self, is_halted: bool) -> None:
        """Halt a tree that has not ended, and wait until all that was begun has stopped."""
        try:
            if is_halted:
                self._executor.halt()
        except Exception as error:
            self._error = self._error or error
        self._executor.take_effects()
        for run in self._runs.values():
            run.scope.cancel()
        while self._runs:
            await next(iter(self._runs.values())).stopped.wait()
