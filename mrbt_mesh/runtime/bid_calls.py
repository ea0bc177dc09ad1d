"""Calls of the bid functions of a robot's program. Only missions with bids load this module."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from numbers import Real
from typing import Any

import anyio
import anyio.abc
import anyio.lowlevel

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.features.bids.messages import BidMade, BidsMade, RequestBid
from mrbt_mesh.features.bids.needs import MAX_BID_WITHIN_US
from mrbt_mesh.runtime.program_function import ProgramFunction
from mrbt_mesh.runtime.task_port import Host
from mrbt_mesh.runtime.user_code import UserCodeError, shown

# The longest that any mission waits for a bid.
BID_LIMIT_S = MAX_BID_WITHIN_US / MICRO


def micro_bid(value: Any) -> int | None:
    """Return a bid in micro-units, or None for no bid. Raises ValueError for an invalid bid."""
    most = MAX_PERFORMANCE // MICRO
    if value is None:
        return None
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not -most <= float(value) <= most:
        raise ValueError(f"a bid is a number from {-most} to {most}, or None, not {shown(value)}")
    return round(float(value) * MICRO)


class BidCalls:
    """Answers `RequestBid`, by tasks of `group`. Bids that end at the same time share one input.

    `function_of` returns the program's bid function for a local-task type, or None. `call` calls
    it, with what it is called for and the local task as its arguments.
    """

    def __init__(
        self,
        group: anyio.abc.TaskGroup,
        host: Host,
        function_of: Callable[[str], ProgramFunction | None],
        call: Callable[[str, ProgramFunction, StartAction], Awaitable[Any]],
    ) -> None:
        self._group = group
        self._host = host
        self._function_of = function_of
        self._call = call
        self._made: list[BidMade] = []

    def answer(self, effect: RequestBid) -> None:
        """Call the function for this bid."""
        self._group.start_soon(self._answer, effect)

    async def _answer(self, effect: RequestBid) -> None:
        value, error, reason = None, "", ""
        try:
            with anyio.move_on_after(BID_LIMIT_S) as scope:
                value = micro_bid(await self._bid(effect))
            if scope.cancelled_caught:
                error = f"no answer within {BID_LIMIT_S:g} s"
        except UserCodeError as failure:
            error, reason = failure.details, failure.reason
        except ValueError as problem:
            error = str(problem)
        names = effect.activation, effect.local_task
        self._made.append(BidMade(*names, value, error, reason or error))
        if len(self._made) == 1:
            self._group.start_soon(self._submit)

    async def _submit(self) -> None:
        # One message carries all bids that end at this moment.
        await anyio.lowlevel.checkpoint()
        bids, self._made = tuple(self._made), []
        self._host.submit(BidsMade(bids))

    async def _bid(self, effect: RequestBid) -> Any:
        name = type_name(effect.local_task)
        function = self._function_of(name)
        if function is None:
            raise ValueError(f"the robot's program has no bid for {name!r}")
        names = effect.activation, effect.global_task, effect.local_task
        start = StartAction(0, *names, (), effect.performance, effect.incarnation)
        return await self._call(f"bid for {effect.local_task}", function, start)
