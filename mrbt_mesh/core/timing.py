"""The knobs of membership and agreement, and what follows from them. Microseconds everywhere."""

from __future__ import annotations

from dataclasses import dataclass

SECOND_US = 1_000_000


@dataclass(frozen=True, slots=True)
class Timing:
    """`beat_us`: heartbeat period. `detection_us`: silence after which a robot is dead.

    A frozen robot is replaced within `detection_us` plus one message delay; a killed one,
    whose liveliness token the system takes down, within two message delays, if at least one
    other robot confirms. Raises ValueError if a detection time has less than 3 beats.
    """

    beat_us: int = 200_000
    detection_us: int = 1_000_000

    def __post_init__(self) -> None:
        if self.beat_us < 1_000 or 3 * self.beat_us > self.detection_us:
            raise ValueError("the detection time must be at least 3 beat periods, a beat 1 ms")

    @property
    def suspect_us(self) -> int:
        """Silence after which a robot is suspect, left out when agreement is counted."""
        return self.detection_us // 2

    @property
    def grace_us(self) -> int:
        """A robot starts without agreement once its line of the plan has stood this long."""
        return self.detection_us * 3 // 10

    @property
    def repair_us(self) -> int:
        """Fact digests that differ for longer than this are repaired by asking."""
        return self.beat_us // 2

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

    def repeats_us(self) -> tuple[int, ...]:
        """After a changed plan is beaten out at once: when it is repeated, as offsets."""
        return (self.beat_us // 8, self.beat_us // 4, self.beat_us // 2)
