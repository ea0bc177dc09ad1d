"""Whether a server can be used, and the requests to it, for servers of all kinds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from .watch import LISTED_S, LifeWatch

NOT_FOUND = "has not been found"
# What waits for so long for a server that is not there has failed.
ABSENT_S = 30.0
# Servers that are found within this time of the first one, or the detection time if that is longer,
# were there before it was found.
FIRST_S = 2.0


@dataclass(frozen=True)
class SendGoal:
    """Ask an action server to take this goal."""

    run: int
    goal_id: bytes
    body: Any


@dataclass(frozen=True)
class CancelGoal:
    """Ask an action server to cancel a goal."""

    goal_id: bytes


@dataclass(frozen=True)
class AskResult:
    """Ask for a goal's result; an unknown goal is answered at once."""

    goal_id: bytes


@dataclass(frozen=True)
class SendCall:
    """Call a service, or publish a message."""

    run: int
    body: Any


@dataclass(frozen=True)
class AskLife:
    """Ask the server a question that it has to answer and that changes nothing."""


@dataclass(frozen=True)
class RunEnded:
    """A run is over. `fields`: the requested fields of the result."""

    run: int
    how: str
    text: str
    fields: dict[str, Any]


@dataclass(frozen=True)
class RunWaits:
    """A run goes on, and something about it has to be known."""

    run: int
    text: str


@dataclass(frozen=True)
class ServerTold:
    """The server can be used from now on, or cannot; `why` is a predicate, as `does not answer`."""

    is_up: bool
    why: str


ServerEffect = (
    SendGoal | CancelGoal | AskResult | SendCall | AskLife | RunEnded | RunWaits | ServerTold
)


class ServerWatch:
    """Whether one server can be used, or a lifecycle node is active. Every method returns what is
    to be done; `now_s` never goes back.
    """

    def __init__(self, detection_s: float, now_s: float) -> None:
        self._watch = LifeWatch(detection_s, now_s)
        # The middleware's ids of the servers of this name: another id is another process. With each
        # one, since when it is known.
        self._servers: dict[bytes, float] = {}
        self._found_s = now_s
        self._first_s = max(FIRST_S, detection_s)
        self._why_not = NOT_FOUND
        self._last = ServerTold(False, self._why_not)

    @property
    def is_clear(self) -> bool:
        """Whether nothing of ours is at the server, or may be."""
        return True

    def heard(self, now_s: float) -> list[ServerEffect]:
        """A sign of life: any answer, or feedback."""
        was_there = self._watch.is_there
        self._watch.heard(now_s)
        effects = [] if was_there else self._came_back(now_s)
        return effects + self._advance(now_s)

    def servers(self, found: frozenset[bytes], now_s: float) -> list[ServerEffect]:
        """The servers of this name that the middleware lists."""
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
        """How many of the listed servers are alive.

        A killed one is listed for a while beside its successor. So one that is not the newest
        counts if it is still listed when the one after it has been there for `LISTED_S`.
        """
        since_s = sorted(self._servers.values())
        return min(1, len(since_s)) + sum(now_s - each >= LISTED_S for each in since_s[1:])

    def unusable(self, why: str) -> list[ServerEffect]:
        """The server is there and reports that it cannot be used now."""
        self._watch.gone()
        self._why_not = why
        return self._told(False)

    def tick(self, now_s: float) -> list[ServerEffect]:
        """Time has passed."""
        was_there = self._watch.is_there
        effects: list[ServerEffect] = [AskLife()] if self._watch.tick(now_s) else []
        if was_there and not self._watch.is_there:
            self._why_not = self._silence() or "does not answer"
        return effects + self._advance(now_s)

    def _silence(self) -> str:
        """Why it may be silent; empty if nothing is known."""
        return ""

    def _came_back(self, now_s: float) -> list[ServerEffect]:
        """It was silent, or never heard before."""
        return []

    def _advance(self, now_s: float) -> list[ServerEffect]:
        return self._told(self._watch.is_there)

    def _told(self, is_up: bool) -> list[ServerEffect]:
        before, self._last = self._last, ServerTold(is_up, "" if is_up else self._why_not)
        return [self._last] if self._last != before else []


class ServerKeeper(ServerWatch, ABC):
    """One server and the runs that it is asked for."""

    @abstractmethod
    def start(self, run: int, goal_id: bytes, body: Any, now_s: float) -> list[ServerEffect]:
        """Begin a run; the one before has ended or was cancelled."""

    @abstractmethod
    def cancel(self, run: int, now_s: float) -> list[ServerEffect]:
        """The run is no longer needed; its end is reported once the server has stopped."""

    @abstractmethod
    def refused(self, run: int, text: str, now_s: float) -> list[ServerEffect]:
        """The run's message does not fit the server's type."""
