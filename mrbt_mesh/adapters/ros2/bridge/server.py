"""Tracks whether a server can be used; base classes and effects for servers of all kinds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from .watch import LISTED_S, LifeWatch

NOT_FOUND = "has not been found"
# A run that waits this long for a missing server has failed.
ABSENT_S = 30.0
# Servers found within this time after the first one, or within the detection time if that is
# longer, are taken to have existed before.
FIRST_S = 2.0


@dataclass(frozen=True)
class SendGoal:
    """Ask an action server to accept this goal."""

    run: int
    goal_id: bytes
    body: Any


@dataclass(frozen=True)
class CancelGoal:
    """Ask an action server to cancel a goal."""

    goal_id: bytes


@dataclass(frozen=True)
class AskResult:
    """Request a goal's result; for an unknown goal the server answers at once."""

    goal_id: bytes


@dataclass(frozen=True)
class SendCall:
    """Call a service, or publish a message."""

    run: int
    body: Any


@dataclass(frozen=True)
class AskLife:
    """Send the server a request that it must answer and that changes nothing."""


@dataclass(frozen=True)
class RunEnded:
    """A run has ended. `fields`: the requested fields of the result."""

    run: int
    how: str
    text: str
    fields: dict[str, Any]


@dataclass(frozen=True)
class RunWaits:
    """A run continues, but `text` about it must be reported."""

    run: int
    text: str


@dataclass(frozen=True)
class ServerTold:
    """Whether the server can be used from now on; `why` is a predicate like `does not answer`."""

    is_up: bool
    why: str


ServerEffect = (
    SendGoal | CancelGoal | AskResult | SendCall | AskLife | RunEnded | RunWaits | ServerTold
)


class ServerWatch:
    """Tracks whether one server can be used, or a lifecycle node is active.

    Methods return effects to carry out; `now_s` is monotonic.
    """

    def __init__(self, detection_s: float, now_s: float) -> None:
        self._watch = LifeWatch(detection_s, now_s)
        # The middleware's ids of the servers of this name, with the time since which each is known.
        # Another id is another process.
        self._servers: dict[bytes, float] = {}
        self._found_s = now_s
        self._first_s = max(FIRST_S, detection_s)
        self._why_not = NOT_FOUND
        self._last = ServerTold(False, self._why_not)

    @property
    def is_clear(self) -> bool:
        """True if the server cannot have any run of this robot."""
        return True

    def heard(self, now_s: float) -> list[ServerEffect]:
        """Process a sign of life: any answer, or feedback."""
        was_there = self._watch.is_there
        self._watch.heard(now_s)
        effects = [] if was_there else self._came_back(now_s)
        return effects + self._advance(now_s)

    def servers(self, found: frozenset[bytes], now_s: float) -> list[ServerEffect]:
        """Process the list of servers of this name that the middleware knows."""
        if not self._servers:
            self._found_s = now_s
        elif not found:
            self._servers.clear()
            return self.unusable("has ended")
        is_first = now_s - self._found_s <= self._first_s
        since_s = now_s - LISTED_S if is_first else now_s
        self._servers = {each: self._servers.get(each, since_s) for each in sorted(found)}
        return []

    def _count(self, now_s: float) -> int:
        """Return how many of the listed servers are alive.

        A killed server is listed for a while beside its successor. So an older server counts only
        if it is still listed when its successor has been known for `LISTED_S`.
        """
        since_s = sorted(self._servers.values())
        return min(1, len(since_s)) + sum(now_s - each >= LISTED_S for each in since_s[1:])

    def unusable(self, why: str) -> list[ServerEffect]:
        """Note that the server cannot be used now; `why` is a predicate."""
        self._watch.gone()
        self._why_not = why
        return self._told(False)

    def tick(self, now_s: float) -> list[ServerEffect]:
        """Advance the time."""
        was_there = self._watch.is_there
        effects: list[ServerEffect] = [AskLife()] if self._watch.tick(now_s) else []
        if was_there and not self._watch.is_there:
            self._why_not = self._silence() or "does not answer"
        return effects + self._advance(now_s)

    def _silence(self) -> str:
        """Return why the server may be silent; empty if unknown."""
        return ""

    def _came_back(self, now_s: float) -> list[ServerEffect]:
        """Called when a server is heard that was silent, or never heard before."""
        return []

    def _advance(self, now_s: float) -> list[ServerEffect]:
        return self._told(self._watch.is_there)

    def _told(self, is_up: bool) -> list[ServerEffect]:
        before, self._last = self._last, ServerTold(is_up, "" if is_up else self._why_not)
        return [self._last] if self._last != before else []


class ServerKeeper(ServerWatch, ABC):
    """One server and the runs that are requested from it."""

    @abstractmethod
    def start(self, run: int, goal_id: bytes, body: Any, now_s: float) -> list[ServerEffect]:
        """Start a run; an earlier one that has not ended is cancelled or awaited."""

    @abstractmethod
    def cancel(self, run: int, now_s: float) -> list[ServerEffect]:
        """Cancel a run that is no longer needed; returns or later reports its end."""

    @abstractmethod
    def refused(self, run: int, text: str, now_s: float) -> list[ServerEffect]:
        """End a run whose message does not fit the server's type."""
