"""How much longer a robot that has trouble itself waits for silent ones.

Source: Lifeguard's local health multiplier (Dadgar, Phillips, Currey 2018).
"""

from __future__ import annotations

from mrbt_mesh.core.membership.timing import Timing

# So many detection times longer at most.
MAX_EXTRA_DETECTIONS = 4


class LocalHealth:
    """Of one robot: each trouble adds a detection time to what it waits, at most one per heartbeat
    period; one is taken off in every detection time, the first one after the longest silence.
    """

    def __init__(self, timing: Timing) -> None:
        self._timing = timing
        self._extra_detections = 0
        self._next_worse_us = 0
        self._next_better_us = 0

    @property
    def is_good(self) -> bool:
        """Whether it waits no longer than usual."""
        return not self._extra_detections

    @property
    def extra_us(self) -> int:
        """How much longer it waits."""
        return self._extra_detections * self._timing.detection_us

    @property
    def better_at_us(self) -> tuple[int, ...]:
        """When that is less next, if at all."""
        return (self._next_better_us,) if self._extra_detections else ()

    def worsen(self, now_us: int) -> None:
        """It was slow, or others held it for dead."""
        if now_us >= self._next_worse_us:
            self._extra_detections = min(MAX_EXTRA_DETECTIONS, self._extra_detections + 1)
            self._next_worse_us = now_us + self._timing.heartbeat_us
            self._next_better_us = now_us + self._timing.max_silence_us

    def recover(self, now_us: int) -> None:
        """Time has passed."""
        if self._extra_detections and now_us >= self._next_better_us:
            self._extra_detections -= 1
            self._next_better_us = now_us + self._timing.detection_us
