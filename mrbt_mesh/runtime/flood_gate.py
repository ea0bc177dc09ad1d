"""Stops a flood: messages that no member of the team has sealed do not pass.

It works before the inbox, on Zenoh's threads, so that a robot has time left for its own messages.
Tags are checked here, and for published messages only here. Signatures take a hundred times as
long: a limited number per second passes for each source, and the agent checks them. The agent opens
whatever passes, with all its other rules.

What exceeds the limits is not only dropped: the thread that brought it waits a little. Zenoh reads
each link on a separate thread, so this slows down only the link over which the flood comes; the
sender's side of it fills up and drops the rest, at no cost here.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    InputRefused,
    MessageReceived,
    QueryReceived,
)
from mrbt_mesh.core.membership.envelope import (
    Envelope,
    ForgedError,
    HeardMessages,
    has_tag,
    parse_envelope,
)
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES, WireError
from mrbt_mesh.runtime.fencing import boottime_us


class Budget:
    """Lets `at_once` through, then `per_s` per second. Times are in us."""

    def __init__(self, at_once: int, per_s: int, now_us: int) -> None:
        self._at_once = at_once
        self._per_s = per_s
        self._left = float(at_once)
        self._at_us = now_us

    def takes(self, now_us: int, amount: int = 1) -> bool:
        """Take `amount` from the budget now; return whether it was available."""
        gained = max(0, now_us - self._at_us) * self._per_s / 1e6
        self._left, self._at_us = min(self._at_once, self._left + gained), now_us
        if self._left < amount:
            return False
        self._left -= amount
        return True


# Checks per second for each source, and at once after a pause.
CHECKS_PER_S = 100
CHECKS_AT_ONCE = 200
# The same for all sources together, in bytes.
BYTES_AT_ONCE = BYTES_PER_S = MAX_MESSAGE_BYTES
# How many sources and reasons are counted separately until the counts are taken.
MAX_REFUSED = 100
# Sources of messages that carry no member's name.
NO_SOURCE, AN_ANSWER, NOBODY = "a query", "an answer", "a stranger"
TOO_MUCH = "too much to check"
# How long a thread waits after bringing too much, and how many may wait at once: fewer than Zenoh
# has (`ZENOH_RUNTIME` in `session_config`), or other links would not be read.
HOLD_S = 0.005
MAX_HELD = 12

Deliver = Callable[[Input, str | None], bool]


class FloodGate:
    """Passes what may be authentic to `deliver`, and counts the rest by source and reason.

    In a team without `keys` every message may be authentic. Methods may be called from any thread.
    `hold` makes a thread wait for a number of seconds, but never if a flood would come over the
    same link as the team's own messages (`is_link_shared`).
    """

    def __init__(
        self,
        keys: Keys | None,
        run: str,
        deliver: Deliver,
        clock: Callable[[], int] = boottime_us,
        hold: Callable[[float], None] = time.sleep,
        is_link_shared: bool = False,
    ) -> None:
        self._keys = keys
        self._run = run
        self._memory = HeardMessages()
        self._deliver = deliver
        self._clock = clock
        self._hold = hold
        self._is_link_shared = is_link_shared
        self._may_wait = threading.Semaphore(MAX_HELD)
        self._lock = threading.Lock()
        self._budgets: dict[str, Budget] = {}
        self._bytes = Budget(BYTES_AT_ONCE, BYTES_PER_S, clock())
        self._refused: dict[tuple[str, str], int] = {}

    def deliver(self, event: Input, slot: str | None) -> bool:
        """Pass an input on, or count it. For `slot` see `Inbox.put`.

        Returns True if a message is authenticated as coming from the named member, or if another
        input was passed on.
        """
        keys = self._keys
        match event:
            case InputRefused(source, reason, count):
                self._refuse(source, reason, count)
            case MessageReceived(kind, source, data) if keys is not None:
                envelope = _checked(keys, data)
                if envelope is not None and self._is_news_of(source, envelope):
                    return self._deliver(MessageReceived(kind, source, data, envelope), slot)
                # An unchecked message must not replace anything.
                name = source if keys.role_of(source) is not None else NOBODY
                if self._is_in_budget(name, data):
                    self._deliver(event, None)
            case QueryReceived(_, _, data) if keys is not None:
                if _checked(keys, data) or self._is_in_budget(NO_SOURCE, data):
                    return self._deliver(event, slot)
            case AnswerReceived(_, data) if keys is not None and data is not None:
                if _checked(keys, data) or self._is_in_budget(AN_ANSWER, data):
                    return self._deliver(event, slot)
            case _:
                return self._deliver(event, slot)
        return False

    def take_refused(self) -> list[InputRefused]:
        """Return what has been refused since the last call."""
        with self._lock:
            found, self._refused = self._refused, {}
        return [InputRefused(*key, count) for key, count in found.items()]

    def _is_news_of(self, source: str, envelope: Envelope) -> bool:
        """Return whether `source` has sealed this for this run, and it was not heard before.

        Old messages must not replace newer ones that wait.
        """
        if envelope.sender != source or envelope.run != self._run:
            return False
        with self._lock:
            try:
                self._memory.take(envelope)
            except WireError:
                return False
        return True

    def _is_in_budget(self, source: str, data: bytes) -> bool:
        now_us = self._clock()
        with self._lock:
            budget = self._budgets.setdefault(source, Budget(CHECKS_AT_ONCE, CHECKS_PER_S, now_us))
            if budget.takes(now_us) and self._bytes.takes(now_us, len(data)):
                return True
        self._refuse(source, TOO_MUCH)
        return False

    def _refuse(self, source: str, reason: str, count: int = 1) -> None:
        """Count a refused input, and slow down its link."""
        key = source, reason
        with self._lock:
            if key not in self._refused and len(self._refused) >= MAX_REFUSED:
                key = NOBODY, reason
            self._refused[key] = self._refused.get(key, 0) + count
        if not self._is_link_shared and self._may_wait.acquire(blocking=False):
            try:
                self._hold(HOLD_S)
            finally:
                self._may_wait.release()


def _checked(keys: Keys, data: bytes) -> Envelope | None:
    """Return the envelope if its tag proves that a member has sealed it."""
    try:
        envelope = parse_envelope(data)
    except ForgedError:
        return None
    return envelope if has_tag(keys, envelope) else None
