"""Answers requests in their order, although one of them may take long.

An answer does not name its request, so answers are sent in order. Each request starts once the
previous one is done, so that tasks are created in the order of their dispatch. If a request waits
for robots, the next ones start nevertheless, and their answers are ready when it is answered.
"""

from __future__ import annotations

from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Generic, TypeVar

import anyio
from anyio.abc import TaskGroup

# After this time the next request starts, even if the previous one is not done.
PATIENCE_S = 0.2
MOST_AT_ONCE = 32
_Request = TypeVar("_Request")
_Answer = TypeVar("_Answer")


class RequestsInOrder(Generic[_Request, _Answer]):
    """The requests of one connection.

    Requests that have started in `group` are finished even if the connection ends.
    """

    def __init__(
        self, group: TaskGroup, carry_out: Callable[[_Request], Awaitable[_Answer]]
    ) -> None:
        self._group = group
        self._carry_out = carry_out
        self._places = anyio.Semaphore(MOST_AT_ONCE)
        # The answers of open requests in order; an answer is an empty list until it is ready.
        self._answers: deque[list[_Answer]] = deque()
        self._changed = anyio.Event()

    async def take(self, request: _Request) -> None:
        """Start a request; returns when the next one may start."""
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
        """Yield the answers in the order of their requests; never ends."""
        while True:
            while self._answers and self._answers[0]:
                (answer,) = self._answers.popleft()
                yield answer
                self._places.release()
            await self._changed.wait()
            self._changed = anyio.Event()
