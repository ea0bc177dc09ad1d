"""Requests that are answered in their order, although one of them may wait for long.

An answer does not say to which request it belongs, so they go out in order. Each request begins
once the one before it is done, so that of two tasks the one dispatched first is the earlier one;
behind one that waits for robots the next ones begin all the same, and are done when its turn is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Generic, TypeVar

import anyio
from anyio.abc import TaskGroup

# Behind one that takes longer the next one begins.
PATIENCE_S = 0.2
MOST_AT_ONCE = 32
_Request = TypeVar("_Request")
_Answer = TypeVar("_Answer")


class RequestsInOrder(Generic[_Request, _Answer]):
    """The requests of one connection. What has begun in `group` is finished, whatever becomes of
    the connection.
    """

    def __init__(
        self, group: TaskGroup, carry_out: Callable[[_Request], Awaitable[_Answer]]
    ) -> None:
        self._group = group
        self._carry_out = carry_out
        self._places = anyio.Semaphore(MOST_AT_ONCE)
        # What is to be answered, the next one first: empty until it is done.
        self._answers: deque[list[_Answer]] = deque()
        self._changed = anyio.Event()

    async def take(self, request: _Request) -> None:
        """Begin a request; returns when the next one may."""
        await self._places.acquire()
        answer: list[_Answer] = []
        self._answers.append(answer)
        is_done = anyio.Event()

        async def carry_out() -> None:
            answer.append(await self._carry_out(request))
            is_done.set()
            self._changed.set()

        self._group.start_soon(carry_out)
        with anyio.move_on_after(PATIENCE_S):
            await is_done.wait()

    async def answers(self) -> AsyncIterator[_Answer]:
        """The answers in the order of their requests; never ends."""
        while True:
            while self._answers and self._answers[0]:
                (answer,) = self._answers.popleft()
                yield answer
                self._places.release()
            await self._changed.wait()
            self._changed = anyio.Event()
