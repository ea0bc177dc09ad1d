"""A transport that reaches nobody and is slow to open."""

from __future__ import annotations

import threading
from typing import Any


class SlowTransport:
    """Takes longer to open than the detection time, as on a machine that is very busy."""

    def __init__(self, config: Any, deliver: Any, life_of: Any) -> None:
        self.is_open = False
        self.used: list[str] = []

    def open(self) -> None:
        threading.Event().wait(0.6)
        self.is_open = True

    def __getattr__(self, name: str) -> Any:
        def used(*arguments: Any) -> list[str]:
            assert self.is_open, f"{name} before the session is open"
            self.used.append(name)
            return []

        return used
