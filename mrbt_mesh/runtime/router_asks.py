"""Gathers questions to routers: when one dies, the tokens of all its clients go at once.

What has come by the next turn of the event loop is asked together, after all of these losses.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from mrbt_mesh.core.agent.effects import AskRouter


class RouterAsks:
    """Hands on to `ask` what is added. It belongs to the event loop in which it is used."""

    def __init__(self, ask: Callable[[Sequence[AskRouter]], None]) -> None:
        self._ask = ask
        self._waiting: list[AskRouter] = []

    def add(self, effect: AskRouter) -> None:
        """Ask this soon."""
        self._waiting.append(effect)
        if len(self._waiting) == 1:
            asyncio.get_running_loop().call_soon(self._flush)

    def _flush(self) -> None:
        waiting, self._waiting = self._waiting, []
        self._ask(waiting)
