"""Messages of other processes, which tests wait for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

WAIT_S = 120.0
_Message = TypeVar("_Message")


class Heard(Generic[_Message]):
    """All messages so far; `add` may be called from any thread."""

    def __init__(self) -> None:
        self.messages: list[_Message] = []
        self._news = threading.Condition()

    def add(self, message: _Message) -> None:
        with self._news:
            self.messages.append(message)
            self._news.notify_all()

    def wait_for(self, holds: Callable[[_Message], bool], what: str, after: int = 0) -> _Message:
        """The first message that `holds` accepts, from number `after` on."""

        def found() -> list[_Message]:
            return [each for each in self.messages[after:] if holds(each)][:1]

        with self._news:
            if not self._news.wait_for(found, WAIT_S):
                raise AssertionError(f"no message: {what}; there were {self.messages}")
            return found()[0]
