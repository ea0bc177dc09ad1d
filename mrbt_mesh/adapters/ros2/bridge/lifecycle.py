"""A lifecycle node that has to be active: it is asked for its state, and nothing is sent to it."""

from __future__ import annotations

from typing import Any

from .server import ServerEffect, ServerKeeper


class StateKeeper(ServerKeeper):
    """One node; `heard` means that it is active."""

    def start(self, run: int, goal_id: bytes, body: Any, now_s: float) -> list[ServerEffect]:
        """It has no runs."""
        raise NotImplementedError

    def cancel(self, run: int, now_s: float) -> list[ServerEffect]:
        """It has no runs."""
        return []

    def refused(self, run: int, text: str, now_s: float) -> list[ServerEffect]:
        """It has no runs."""
        return []

    @property
    def is_clear(self) -> bool:
        """Nothing is ever at it."""
        return True
