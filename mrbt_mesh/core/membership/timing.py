"""The knobs of membership and agreement, and what follows from them. Microseconds everywhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

SECOND_US = 1_000_000
NEVER_US = 1 << 62

# A verdict waits until the odds of that much silence, by what was measured, are below 1 in 2**20.
ODDS_BITS = 20
# While a robot is sought, nobody receives more than about this many beats per beat period.
CROWD = 32


@lru_cache(maxsize=4_096)
def _unlikely_beats(silence_permille: int, most: int) -> int:
    """So many silent beat periods in a row are no chance any more; at most `most`."""
    odds, beats = 1 << 40, 0
    while odds > 1 << (40 - ODDS_BITS) and beats < most:
        odds = odds * silence_permille // 1_000
        beats += 1
    return beats


@dataclass(frozen=True, slots=True)
class Timing:
    """`beat_us`: heartbeat period. `detection_us`: silence after which a robot is dead.

    That is on a good network; `limit_us` says how long it takes on a bad one. A frozen robot
    is replaced within that time plus one message delay; a killed one, whose liveliness token
    the system takes down, within two message delays, if at least one other robot confirms.
    Raises ValueError if a detection time has less than 3 beats.
    """

    heartbeat_us: int = 200_000
    detection_us: int = 1_000_000

    def __post_init__(self) -> None:
        if self.heartbeat_us < 1_000 or 3 * self.heartbeat_us > self.detection_us:
            raise ValueError("the detection time must be at least 3 beat periods, a beat 1 ms")

    def silence_limit_us(self, overdue_permille: int) -> int:
        """Silence after which a robot is dead of which, so far, no news came in that share of
        the beat periods: so many periods that chance explains it with odds below 2**-20.

        At least the detection time, at most `max_limit_us`.
        """
        beats = _unlikely_beats(overdue_permille, self.max_silence_us // self.heartbeat_us)
        return max(self.detection_us, beats * self.heartbeat_us)

    @property
    def max_silence_us(self) -> int:
        """The longest silence that a robot survives."""
        return 3 * self.detection_us

    @property
    def max_detection_us(self) -> int:
        """The longest time to a verdict: the worst network, and most peers vanish together."""
        return self.max_silence_us + self.detection_us

    @property
    def fence_us(self) -> int:
        """A robot that was silent for longer takes it that it was replaced.

        The shortest time in which others may do that by silence alone, whatever they measured.
        """
        return self.detection_us

    @property
    def grace_us(self) -> int:
        """A robot starts without agreement once its line of the plan has stood this long."""
        return self.detection_us * 3 // 10

    @property
    def bid_wait_us(self) -> int:
        """A request waits this long for bids, where the mission does not say how long."""
        return self.detection_us * 3 // 10

    @property
    def repair_us(self) -> int:
        """Fact digests that differ for longer than this are repaired by asking."""
        return self.heartbeat_us // 2

    @property
    def ask_timeout_us(self) -> int:
        """An unanswered question is asked again after this."""
        return self.detection_us // 2

    @property
    def lease_us(self) -> int:
        """A grant for an exclusive task runs out this long after its last renewal arrived."""
        return 3 * self.detection_us

    @property
    def hold_us(self) -> int:
        """The holder counts on a grant for this long after it sent the request.

        Shorter than the lease by as much as the clocks of the two may drift apart meanwhile.
        """
        return self.lease_us * 3 // 4

    def repeat_offsets_us(self) -> tuple[int, ...]:
        """After a changed plan is beaten out at once: when it is repeated, as offsets."""
        return (self.heartbeat_us // 8, self.heartbeat_us // 4, self.heartbeat_us // 2)

    def fast_heartbeat_us(self, robots: int) -> int:
        """The beat period while a robot is sought; more robots relay more, and need less haste."""
        return min(
            self.heartbeat_us, max(self.heartbeat_us // 4, self.heartbeat_us * robots // CROWD)
        )
