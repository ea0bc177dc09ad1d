"""Holds back the program's next step until the robot has heard enough (`core.agent.stepping`).

Received inputs are processed first: if the machine was paused with all its clocks, they show it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from typing import Any

# The number of loop turns that a cancellation may take to reach the program.
TURNS = 8


class StepGate:
    """`take_news` processes waiting inputs.

    `may_step` returns whether the program may then continue.
    """

    def __init__(self, take_news: Callable[[], None], may_step: Callable[[], bool]) -> None:
        self._take_news = take_news
        self._may_step = may_step
        self._waiting: list[asyncio.Future[None]] = []

    def look(self) -> None:
        """Release waiting steps if the agent has heard enough."""
        if self._waiting and self._may_step():
            for news in self._waiting:
                if not news.done():
                    news.set_result(None)

    def pass_through(self, is_cancelled: Callable[[], bool]) -> Generator[Any, None, None]:
        """Wait in the program's task until it may continue.

        If its action was cancelled, the cancellation reaches it here, unless it shields itself.
        """
        self._take_news()
        while not self._may_step():
            news = asyncio.get_running_loop().create_future()
            self._waiting.append(news)
            try:
                yield from news
            finally:
                self._waiting.remove(news)
            self._take_news()
        for _ in range(TURNS):
            if not is_cancelled():
                return
            yield
