"""When to send heartbeats: regularly; at once after something urgent has changed, and again soon
after; and faster while a robot is probed.
"""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.membership.timing import Timing


class HeartbeatSchedule:
    """The schedule of one robot's heartbeats, and their counter.

    `next_due_us` is when the next one is due, if nothing urgent changes before.
    """

    def __init__(self, timing: Timing, now_us: int) -> None:
        self._timing = timing
        self._offsets_us = timing.repeat_offsets_us()
        self._number = 0
        self._last_urgent: tuple[Any, ...] | None = None
        self._repeats_us: list[int] = []
        self._regular_us = now_us
        self._fast_until_us = now_us
        self._fast_period_us = timing.heartbeat_us
        self.last_sent_us = now_us
        self.next_due_us = now_us

    def make_due(self, now_us: int) -> None:
        """Make a heartbeat due now."""
        self._schedule(now_us)

    def speed_up(self, robots: int, now_us: int) -> None:
        """Send faster for one heartbeat period: a robot is probed, in a team of so many robots."""
        self._fast_period_us = self._timing.fast_heartbeat_us(robots)
        self._fast_until_us = now_us + self._timing.heartbeat_us
        self._schedule(min(self._regular_us, self.last_sent_us + self._fast_period_us))

    def _schedule(self, regular_us: int) -> None:
        self._regular_us = regular_us
        self.next_due_us = min([regular_us, *self._repeats_us])

    def is_due(self, urgent: tuple[Any, ...], now_us: int) -> bool:
        """Whether to send now: by the schedule, or because `urgent` has changed."""
        return urgent != self._last_urgent or now_us >= self.next_due_us

    def is_regular_due(self, now_us: int) -> bool:
        """Whether it is time even if nothing were urgent."""
        return now_us >= self._regular_us

    def mark_sent(self, urgent: tuple[Any, ...], now_us: int, is_aside: bool = False) -> int:
        """A heartbeat goes out now; returns its number.

        `is_aside`: not to all who expect one regularly, for whom the next is due as before.
        """
        if urgent != self._last_urgent:
            self._last_urgent = urgent
            self._repeats_us = [now_us + offset_us for offset_us in self._offsets_us]
        else:
            self._repeats_us = [due_us for due_us in self._repeats_us if due_us > now_us]
        self._number += 1
        if is_aside:
            self._schedule(self._regular_us)
            return self._number
        is_fast = now_us < self._fast_until_us
        self._schedule(now_us + (self._fast_period_us if is_fast else self._timing.heartbeat_us))
        self.last_sent_us = now_us
        return self._number
