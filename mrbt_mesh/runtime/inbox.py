"""Passes inputs from Zenoh's threads to the event loop: bounded, ordered, one wake-up at a time.

Zenoh calls back on its own threads. Posting every message to the loop would grow without bound
while the loop is busy, so messages wait here, and at most one wake-up is pending. Most heartbeats
carry no news: they do not wake the loop, which takes them now and then.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from operator import itemgetter
from typing import Any

from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    MessageReceived,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.membership.wire import MessageKind, urgent_part
from mrbt_mesh.runtime.fencing import boottime_us

MAX_WAITING, MAX_WAITING_BYTES = 10_000, 16 << 20
# The maximum number of waiting heartbeats without news.
MAX_QUIET = 1_000


class Inbox:
    """Inputs from other threads, in order of arrival.

    A newer input under the same `key` replaces a waiting one (a beat makes the beat before it
    obsolete). Beyond `MAX_WAITING` inputs or `MAX_WAITING_BYTES`, the oldest are dropped and
    counted; facts lost that way are repaired by the digests in the beats. `are_beats_quiet`:
    heartbeats without news wait for `take_quiet`; it may be changed from the loop.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        wake: Callable[[], None],
        are_beats_quiet: bool = False,
    ) -> None:
        self._loop = loop
        self._wake = wake
        self._lock = threading.Lock()
        self._waiting: OrderedDict[Any, Input] = OrderedDict()
        self._bytes = 0
        self._number = 0
        self._pending = False
        self.are_beats_quiet = are_beats_quiet
        # By key: heartbeats that do not wake the loop, with their arrival times; the urgent part of
        # the newest heartbeat.
        self._quiet: dict[str, tuple[int, MessageReceived]] = {}
        self._urgent: dict[str, tuple[Any, ...] | None] = {}
        self.dropped = 0

    def put(self, event: Input, key: str | None = None) -> bool:
        """Add an input. May be called from any thread, never blocks for long, never raises.

        Always returns True, because messages are not checked here.
        """
        with self._lock:
            if key is not None and self.are_beats_quiet:
                if isinstance(event, MessageReceived) and self._is_quiet(event, key):
                    self._quiet[key] = boottime_us(), event
                    return True
                self._quiet.pop(key, None)
            if isinstance(event, TokenChanged):
                # A beat from before the change must not seem to have come after it.
                before = f"beat/{event.robot}"
                if before in self._quiet:
                    _, beat = self._quiet.pop(before)
                    self._waiting[before], self._bytes = beat, self._bytes + _size(beat)
            self._number += 1
            slot: Any = self._number if key is None else key
            self._bytes += _size(event) - _size(self._waiting.pop(slot, None))
            self._waiting[slot] = event
            while len(self._waiting) > MAX_WAITING or self._bytes > MAX_WAITING_BYTES:
                self._bytes -= _size(self._waiting.popitem(last=False)[1])
                self.dropped += 1
            if self._pending:
                return True
            self._pending = True
        # The loop is closed if the process is about to end.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._wake)
        return True

    def _is_quiet(self, event: MessageReceived, key: str) -> bool:
        """Return whether it is a heartbeat without news, and no heartbeat with news waits under its
        key.
        """
        if event.kind is not MessageKind.HEARTBEAT:
            return False
        part = urgent_part(event.data if event.envelope is None else event.envelope.data)
        before, self._urgent[key] = self._urgent.get(key), part
        has_room = key in self._quiet or len(self._quiet) < MAX_QUIET
        return part is not None and part == before and key not in self._waiting and has_room

    def take_quiet(self, since_us: int) -> list[MessageReceived]:
        """Return the heartbeats without news, with their arrival times but none before `since_us`.

        Call it from the loop.
        """
        if not self._quiet:
            return []
        with self._lock:
            waiting, self._quiet = sorted(self._quiet.values(), key=itemgetter(0)), {}
        return [replace(event, arrived_us=max(at_us, since_us)) for at_us, event in waiting]

    @property
    def is_empty(self) -> bool:
        """True if nothing waits; an input that another thread is just adding may be missed."""
        return not self._waiting and not self._quiet

    def take(self) -> list[Input]:
        """Return all waiting inputs, oldest first. Call it from the loop."""
        with self._lock:
            self._pending = False
            events = list(self._waiting.values())
            self._waiting.clear()
            self._bytes = 0
        return events


def _size(event: Input | None) -> int:
    """Return the size of a message in bytes; 0 for other inputs."""
    match event:
        case MessageReceived(_, _, data) | QueryReceived(_, _, data) | AnswerReceived(_, data):
            return len(data or b"")
    return 0
