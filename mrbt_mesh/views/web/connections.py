"""Limits on the connections of the page's server, and on the time that a request may take.

Many connections or half a request keep no other client out: the server closes idle connections
first, and of these one of the address that has the most.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Collection, Hashable
from typing import Protocol, TypeVar

from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_CONNECTIONS = 256
# A request must be complete within this time of the connection's begin or the last answer.
REQUEST_TIMEOUT_S = 10.0


class Guest(Hashable, Protocol):
    """Something that takes one of a limited number of places."""

    @property
    def address(self) -> str:
        """The address of the machine at the other end."""

    @property
    def is_served(self) -> bool:
        """True while it is being served: it gives up its place last."""


G = TypeVar("G", bound=Guest)


def gives_way(guests: Collection[G]) -> G:
    """Return which of several guests, oldest first, gives up its place to a new one."""
    counts = Counter(guest.address for guest in guests)
    return min(guests, key=lambda guest: (guest.is_served, -counts[guest.address]))


class LimitedHttp(H11Protocol):
    """uvicorn's protocol with these limits."""

    _timer: asyncio.TimerHandle | None = None

    @property
    def address(self) -> str:
        return self.client[0] if self.client else ""

    @property
    def is_served(self) -> bool:
        """True while a complete request is not fully answered."""
        cycle = self.cycle
        return cycle is not None and not cycle.response_complete and not cycle.more_body

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._begun_s = self.loop.time()
        self._watch()
        if len(self.connections) > MAX_CONNECTIONS:
            found = [each for each in self.connections if isinstance(each, LimitedHttp)]
            others = sorted((each for each in found if each is not self), key=lambda e: e._begun_s)
            gives_way(others).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._unwatch()

    def handle_events(self) -> None:
        super().handle_events()
        self._watch()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._watch()

    def _watch(self) -> None:
        if self.is_served or self.transport.is_closing():
            self._unwatch()
        elif self._timer is None:
            self._timer = self.loop.call_later(REQUEST_TIMEOUT_S, self.transport.abort)

    def _unwatch(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
