"""Holds back the program's next step until the robot has heard enough (`core.agent.stepping`).

What has arrived is taken in first: if the machine was paused with all its clocks, that shows it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from typing import Any

# How many turns of the event loop a cancellation may take to reach the program.
TURNS = 8


class StepGate:
    """`take_news`: has what waits taken in. `may_step`: whether the program may go on then."""

    def __init__(self, take_news: Callable[[], None], may_step: Callable[[], bool]) -> None:
        self._take_news = take_news
        self._may_step = may_step
        self._waiting: list[asyncio.Future[None]] = []

    def look(self) -> None:
        """The agent may have heard something: let go on what waits for that."""
        if self._waiting and self._may_step():
            for news in self._waiting:
                if not news.done():
                    news.set_result(None)

    def pass_through(self, is_cancelled: Callable[[], bool]) -> Generator[Any, None, None]:
        """Wait, in the program's task, until it may go on.

        If its action was cancelled, that reaches it here, unless it shields itself.
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
