"""What stops a flood: messages that nobody of the team has sealed go no further than here.

It stands before the inbox, on Zenoh's threads, so that a robot has time left for its own. Tags are
checked here. Signatures take a hundred times as long: so many a second are let through for each
source, and the agent checks them; the same goes for liveliness tokens, which prove nothing.
Whatever passes is opened by the agent, with all its rules.

What is beyond that is not only dropped: the thread that brought it waits a little. Zenoh reads each
link on a thread of its own, so this slows down the link over which the flood comes, and no other;
the sender's side of it fills up and drops the rest before it costs anybody here anything.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from mrbt_mesh.core.agent.inputs import (
    Input,
    InputRefused,
    MessageReceived,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.membership.envelope import ForgedError, HeardMessages, has_tag, parse_envelope
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.runtime.fencing import boottime_us

# What each source may have checked in a second, and at once after a pause.
CHECKS_PER_S = 100
CHECKS_AT_ONCE = 200
MAX_SOURCES = 2_000
NO_SOURCE = "a query"
# How long a thread waits that has brought too much, and how many may wait at once: fewer than Zenoh
# has (`ZENOH_RUNTIME` in `zenoh_transport`), or nobody would read the links of the others.
HOLD_S = 0.005
MAX_HELD = 12

Deliver = Callable[[Input, str | None], bool]


class TokenBucket:
    """Lets `CHECKS_AT_ONCE` through, then `CHECKS_PER_S` in each second. Times are in us."""

    def __init__(self, now_us: int) -> None:
        self._left = float(CHECKS_AT_ONCE)
        self._at_us = now_us

    def takes(self, now_us: int) -> bool:
        """Whether one more may pass now."""
        gained = max(0, now_us - self._at_us) * CHECKS_PER_S / 1e6
        self._left, self._at_us = min(CHECKS_AT_ONCE, self._left + gained), now_us
        if self._left < 1:
            return False
        self._left -= 1
        return True


class FloodGate:
    """Hands on to `deliver` what may be authentic, and counts the rest by source and reason.

    Its methods may be called from any thread. `life`: this member's own, as commands name it.
    `hold` makes a thread wait for so many seconds; never where a flood would come over the same
    link as the team's own messages (`is_link_shared`).
    """

    def __init__(
        self,
        keys: Keys,
        run: str,
        deliver: Deliver,
        life: int = 0,
        clock: Callable[[], int] = boottime_us,
        hold: Callable[[float], None] = time.sleep,
        is_link_shared: bool = False,
    ) -> None:
        self._keys = keys
        self._run = run
        self._memory = HeardMessages()
        self._deliver = deliver
        self._life = life
        self._clock = clock
        self._hold = hold
        self._is_link_shared = is_link_shared
        self._may_wait = threading.Semaphore(MAX_HELD)
        self._lock = threading.Lock()
        self._buckets: dict[str, TokenBucket] = {}
        self._refused: dict[tuple[str, str], int] = {}

    def deliver(self, event: Input, slot: str | None) -> bool:
        """Hand on an input, or count it. For `slot` see `Inbox.put`.

        Returns whether it is shown to come from the member that it names.
        """
        match event:
            case MessageReceived(_, source, data):
                # What is not checked yet must not take the place of anything.
                if self._is_news_of(source, data):
                    return self._deliver(event, slot)
                if self._is_in_budget(source):
                    self._deliver(event, None)
            case QueryReceived(_, kind, data):
                life = self._life if kind is MessageKind.COMMAND else None
                if self._has_tag(data, life) or self._is_in_budget(NO_SOURCE):
                    self._deliver(event, slot)
            case TokenChanged(robot):
                if self._is_in_budget(f"{robot}'s token"):
                    self._deliver(event, slot)
            case InputRefused(source):
                if self._is_in_budget(source):
                    self._deliver(event, slot)
            case _:
                self._deliver(event, slot)
        return False

    def take_refused(self) -> list[InputRefused]:
        """What has been refused since the last call."""
        with self._lock:
            found, self._refused = self._refused, {}
        return [InputRefused(*key, count) for key, count in found.items()]

    def _is_news_of(self, source: str, data: bytes) -> bool:
        """Whether a tag shows that `source` has sealed this, and it was not heard before.

        Old messages must not take the place of newer ones that wait.
        """
        try:
            envelope = parse_envelope(data)
        except ForgedError:
            return False
        is_own = envelope.sender == source and envelope.run == self._run
        if not is_own or not has_tag(self._keys, envelope):
            return False
        with self._lock:
            return self._memory.is_news(envelope)

    def _has_tag(self, data: bytes, life: int | None) -> bool:
        """Whether a tag shows that a member has sealed this; `life`: see `has_tag`."""
        try:
            return has_tag(self._keys, parse_envelope(data), life)
        except ForgedError:
            return False

    def _is_in_budget(self, source: str) -> bool:
        now_us = self._clock()
        with self._lock:
            if source not in self._buckets and len(self._buckets) >= MAX_SOURCES:
                self._buckets.clear()
            bucket = self._buckets.setdefault(source, TokenBucket(now_us))
            if bucket.takes(now_us):
                return True
            key = (source, "too much to check")
            self._refused[key] = self._refused.get(key, 0) + 1
        if not self._is_link_shared and self._may_wait.acquire(blocking=False):
            try:
                self._hold(HOLD_S)
            finally:
                self._may_wait.release()
        return False
