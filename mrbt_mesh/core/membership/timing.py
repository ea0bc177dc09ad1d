"""The two settings of membership, all durations derived from them, in microseconds, and when
heartbeats are sent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

SECOND_US = 1_000_000
NEVER_US = 1 << 62

# A robot is dead once the odds of such a silence, by what was measured, are below 1 in 2**20. Where
# not all robots are neighbours, the odds decrease with the size of the team.
ODDS_BITS = 20
# While a robot is probed, nobody receives more than about this many heartbeats per period.
MAX_RECEIVED = 32


@lru_cache(maxsize=4_096)
def _unlikely_periods(overdue_permille: int, odds_bits: int, most: int) -> int:
    """How many silent heartbeat periods in a row rule out chance; at most `most`."""
    odds, periods = 1 << 40, 0
    while odds > 1 << (40 - odds_bits) and periods < most:
        odds = odds * overdue_permille // 1_000
        periods += 1
    return periods


@dataclass(frozen=True, slots=True)
class Timing:
    """`heartbeat_us`: heartbeat period. `detection_us`: silence after which a robot is dead.

    The latter holds on a good network; on a bad one it takes `silence_limit_us`. A frozen robot is
    replaced within that time plus one message delay. A killed robot, whose liveliness token is
    withdrawn by the system, is replaced within two message delays if another robot lost the token
    too. `reach`: the most steps between neighbours in the ring of the team, on either side.
    `odds_bits`: a silence is no longer chance if its odds are below 1 in 2**odds_bits. Raises
    ValueError if a detection time has less than 3 heartbeats, or a heartbeat less than 1 ms.
    """

    heartbeat_us: int = 200_000
    detection_us: int = 1_000_000
    reach: int = 3
    odds_bits: int = ODDS_BITS

    def __post_init__(self) -> None:
        if self.heartbeat_us < 1_000 or 3 * self.heartbeat_us > self.detection_us:
            raise ValueError("the detection time must be at least 3 beat periods, a beat 1 ms")

    def of_team(self, robots: int) -> Timing:
        """Return the timing for a team of `robots`.

        Where not all robots are neighbours, heartbeats are at most half as frequent and the
        detection time is half as long again, so that a robot with six neighbours has no more to do
        than one in a team of six. Beyond that only the odds depend on the size of the team: in a
        team of twice the size, twice as many robots are declared dead by chance.
        """
        if self.all_are_neighbours(robots):
            return self
        detection_us = self.detection_us * 3 // 2
        return replace(
            self,
            heartbeat_us=min(2 * self.heartbeat_us, detection_us // 3),
            detection_us=detection_us,
            odds_bits=self.odds_bits + ((robots - 1) // (2 * self.reach + 1)).bit_length(),
        )

    def all_are_neighbours(self, robots: int) -> bool:
        """True if all robots of a team of this size are neighbours."""
        return robots <= 2 * self.reach + 1

    def silence_limit_us(self, overdue_permille: int) -> int:
        """Silence after which a robot is dead whose news was overdue for this share of the time so
        far: enough heartbeat periods that the odds of chance are below 2**-odds_bits.

        At least the detection time, at most `max_silence_us`.
        """
        most = self.max_silence_us // self.heartbeat_us
        periods = _unlikely_periods(overdue_permille, self.odds_bits, most)
        return max(self.detection_us, periods * self.heartbeat_us)

    @property
    def overdue_us(self) -> int:
        """News of a robot is overdue after this much silence."""
        return self.heartbeat_us * 5 // 4

    @property
    def max_silence_us(self) -> int:
        """The longest silence that a robot survives."""
        return 3 * self.detection_us

    @property
    def max_detection_us(self) -> int:
        """The longest time until a robot is declared dead: on the worst network, when most robots
        fall silent together.
        """
        return self.max_silence_us + self.detection_us

    @property
    def fence_us(self) -> int:
        """A robot that was silent for longer assumes that it was replaced.

        This is the shortest time in which others may replace it for its silence alone, whatever
        they measured.
        """
        return self.detection_us

    @property
    def grace_us(self) -> int:
        """A robot starts without agreement once it has had the same assignment for this long."""
        return self.detection_us * 3 // 10

    @property
    def failure_latch_us(self) -> int:
        """How long all must agree that no living robot can make good a failure, if the mission does
        not set a time: one more detection time.
        """
        return self.detection_us

    @property
    def repair_us(self) -> int:
        """Fact digests that differ for longer than this are repaired by a pull."""
        return self.heartbeat_us // 2

    @property
    def ask_timeout_us(self) -> int:
        """An unanswered pull is repeated after this time."""
        return self.detection_us // 2

    @property
    def promise_us(self) -> int:
        """A promise for a limited time ends this long after the last request for it arrived."""
        return 3 * self.detection_us

    @property
    def hold_us(self) -> int:
        """Who has such a promise counts on it for this long after it sent the request.

        That is shorter, by more than the two clocks may drift apart in that time.
        """
        return self.promise_us * 3 // 4

    @property
    def news_us(self) -> int:
        """A program that needs the promises of a majority goes on for this long without news."""
        return max(self.detection_us // 2, self.heartbeat_us * 5 // 2)

    def repeat_offsets_us(self) -> tuple[int, ...]:
        """The delays after which an urgent heartbeat is repeated."""
        return (self.heartbeat_us // 8, self.heartbeat_us // 4, self.heartbeat_us // 2)

    def fast_heartbeat_us(self, robots: int) -> int:
        """The heartbeat period while a robot is probed: longer where more robots relay."""
        fast_us = max(self.heartbeat_us // 4, self.heartbeat_us * robots // MAX_RECEIVED)
        return min(self.heartbeat_us, fast_us)


class HeartbeatSchedule:
    """The schedule and the counter of one robot's heartbeats.

    They are sent regularly; at once after something urgent has changed, and again soon after; and
    faster while a robot is probed.

    `next_due_us`: when the next heartbeat is due, if nothing urgent changes before.
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
        """Send faster for one heartbeat period: a robot is probed, in a team of `robots`."""
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
        """True if a regular heartbeat is due, even if nothing is urgent."""
        return now_us >= self._regular_us

    def mark_sent(self, urgent: tuple[Any, ...], now_us: int, is_plan_only: bool = False) -> int:
        """Note that a heartbeat is sent now. Returns its number.

        `is_plan_only`: it does not go to every robot that expects regular heartbeats, so the next
        regular one stays due as before.
        """
        if urgent != self._last_urgent:
            self._last_urgent = urgent
            self._repeats_us = [now_us + offset_us for offset_us in self._offsets_us]
        else:
            self._repeats_us = [due_us for due_us in self._repeats_us if due_us > now_us]
        self._number += 1
        if is_plan_only:
            self._schedule(self._regular_us)
            return self._number
        is_fast = now_us < self._fast_until_us
        self._schedule(now_us + (self._fast_period_us if is_fast else self._timing.heartbeat_us))
        self.last_sent_us = now_us
        return self._number


def earlier_median(values: list[int]) -> int:
    """The median; of an even number of values the smaller of the two in the middle."""
    return sorted(values)[(len(values) - 1) // 2]
