"""The calls of one service, or the messages of one topic, which ROS 2 cannot cancel.

An answer may be lost, but a call must not be repeated: after a while a missing answer is reported.
"""

from __future__ import annotations

from typing import Any

from .server import ABSENT_S, RunEnded, RunWaits, SendCall, ServerEffect, ServerKeeper

# After this time without an answer, the robot logs it once.
WAITS_S = 10.0


class CallKeeper(ServerKeeper):
    """Makes one service's calls, one at a time. A published message is a call that ends at once."""

    def __init__(self, detection_s: float, now_s: float) -> None:
        super().__init__(detection_s, now_s)
        self._run: int | None = None
        self._body: Any = None
        self._is_sent = False
        self._since_s = now_s
        # When the call was made; None once the wait was reported.
        self._sent_s: float | None = None

    def start(self, run: int, goal_id: bytes, body: Any, now_s: float) -> list[ServerEffect]:
        """Start a new call; an unfinished one is cancelled."""
        effects = self.cancel(self._run, now_s) if self._run is not None else []
        self._run, self._body, self._is_sent, self._since_s = run, body, False, now_s
        return effects + self._advance(now_s)

    def cancel(self, run: int, now_s: float) -> list[ServerEffect]:
        """Cancel a call, whose answer is no longer needed."""
        return self._end(run, "cancelled", "", {})

    def refused(self, run: int, text: str, now_s: float) -> list[ServerEffect]:
        """End a run whose request does not fit the server's type."""
        return self._end(run, "unfit", text, {})

    def answered(
        self, run: int, text: str, fields: dict[str, Any], now_s: float
    ) -> list[ServerEffect]:
        """End a run because the service has answered."""
        return self.heard(now_s) + self._end(run, "succeeded", text, fields)

    def published(self, run: int) -> list[ServerEffect]:
        """End a run because its message was published; whether it was received is unknown."""
        return self._end(run, "succeeded", "", {})

    @property
    def is_clear(self) -> bool:
        """True if no answer is awaited."""
        return self._run is None

    def _came_back(self, now_s: float) -> list[ServerEffect]:
        # The answer may have been lost with the server's process.
        return self._end(self._run, "lost", "", {}) if self._is_sent else []

    def _advance(self, now_s: float) -> list[ServerEffect]:
        is_one = (count := self._count(now_s)) <= 1
        if self._watch.is_there and not is_one:
            self._why_not = f"is {count} servers that would all be called: give them namespaces"
        effects = self._told(self._watch.is_there and is_one)
        if self._watch.is_there and is_one and self._run is not None and not self._is_sent:
            self._is_sent, self._sent_s = True, now_s
            effects.append(SendCall(self._run, self._body))
        is_waiting = self._run is not None and not self._is_sent
        if is_waiting and not self._watch.is_there and now_s - self._since_s >= ABSENT_S:
            effects += self._end(self._run, "absent", self._why_not, {})
        is_late = self._sent_s is not None and now_s - self._sent_s >= WAITS_S
        if self._run is not None and self._is_sent and is_late:
            self._sent_s = None
            text = f"no answer for {WAITS_S:g} s, and it cannot be asked again"
            effects.append(RunWaits(self._run, text))
        return effects

    def _end(
        self, run: int | None, how: str, text: str, fields: dict[str, Any]
    ) -> list[ServerEffect]:
        if run is None or run != self._run:
            return []
        self._run, self._body, self._is_sent = None, None, False
        return [RunEnded(run, how, text, fields)]
