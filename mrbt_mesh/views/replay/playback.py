"""Where a replay is, and how fast it goes on."""

from __future__ import annotations

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.recording.player import Player

SLOWEST, FASTEST = 0.01, 1000.0


class Playback:
    """`at_us` is where it is, always within the recording; `catch_up` brings the player there.

    `speed` is within `SLOWEST` and `FASTEST`.
    """

    def __init__(self, player: Player, at_us: int, speed: float) -> None:
        self.player = player
        self.speed = speed
        self.is_paused = False
        self.at_us = player.begin_us
        self.go_to(at_us)

    @property
    def is_at_end(self) -> bool:
        """Whether nothing is left to be played."""
        return self.at_us == self.player.end_us

    def go_to(self, at_us: int) -> None:
        """Go there, or as near as the recording has it."""
        self.at_us = min(max(at_us, self.player.begin_us), self.player.end_us)

    def set_speed(self, speed: float) -> None:
        """Go on so many times faster, or as near to that as can be."""
        self.speed = min(max(speed, SLOWEST), FASTEST)

    def passed(self, seconds: float) -> None:
        """So much time has passed for whoever looks on."""
        if not self.is_paused:
            self.go_to(self.at_us + round(seconds * self.speed * SECOND_US))

    def catch_up(self) -> None:
        """Bring the player to `at_us`. Raises RecordingError where that cannot be played."""
        self.player.seek(self.at_us)
