"""A recording as people look at it: its whole timeline, and the team at one place of it."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.recording.player import Player
from mrbt_mesh.views.model.changes import ChangeLog
from mrbt_mesh.views.model.team_view import TakeoversView, TeamState
from mrbt_mesh.views.model.timeline import TimelineView
from mrbt_mesh.views.replay.playback import Playback


class ShownRecording:
    """`changes` has the items of a `TeamView`: those of the timeline for the whole recording, the
    others as the team was where `playback` is; and `playback`: where that is, in seconds.

    Times are told from the start of the run, as on a live page, so the recording may begin before
    0. Raises RecordingError where it is damaged.
    """

    def __init__(self, player: Player, at_us: int, speed: float) -> None:
        self.changes = ChangeLog()
        self._start_us = self._put_whole_run(player)
        self.playback = Playback(player, at_us, speed)
        self.playback.catch_up()
        self._begin_state()
        self._shown: set[str] = set()

    def _put_whole_run(self, player: Player) -> int:
        """Play all of it once, for the timeline; when the run started."""
        takeovers = TakeoversView(player.observer)
        # What stands at one time happened in one step.
        for at_us in sorted({record.at_us for record in player.recording.records}):
            player.seek(at_us)
            takeovers.put(self.changes)
        record = player.observer.record
        TimelineView(record).put(self.changes)
        return player.begin_us if record.started_us is None else record.started_us

    def _begin_state(self) -> None:
        self._state = TeamState(self.observer, ChangeLog())
        self._taken = 0

    @property
    def observer(self) -> Observer:
        """The team as it was there."""
        return self.playback.player.observer

    def seconds(self, at_us: int) -> float:
        """A time of the recording as seconds from the start of the run."""
        return round((at_us - self._start_us) / SECOND_US, 6)

    def go_to(self, at_s: float) -> None:
        """Go to so many seconds after the start of the run."""
        self.playback.go_to(self._start_us + round(at_s * SECOND_US))

    def play(self, is_paused: bool) -> None:
        """Go on, at the end from the begin; or pause."""
        playback = self.playback
        playback.is_paused = is_paused
        if not is_paused and playback.is_at_end:
            playback.go_to(playback.player.begin_us)

    def passed(self, seconds: float) -> None:
        """So much time has passed for whoever looks on; at the end it pauses."""
        self.playback.passed(seconds)
        self.playback.is_paused |= self.playback.is_at_end

    def step(self, records: int) -> bool:
        """Play so many records at most; whether the player is where it is to be.

        A recording with large plans takes its time, in which others must be served.
        """
        playing = self.playback.player.play_to(self.playback.at_us)
        for count, _ in enumerate(playing, 1):
            if self._state.observer is not self.observer:
                self._begin_state()  # it went back
            self._state.count_activations()
            if count == records:
                return False
        return True

    def update(self, now_us: int) -> bool:
        """Bring `changes` up to date, for the player's time; whether anything has changed."""
        before = self.changes.version
        if self._state.observer is not self.observer:
            self._begin_state()
        is_anew = self._taken == 0
        self._state.update(now_us)
        items = self._state.changes.since(self._taken)
        self._taken = self._state.changes.version
        if is_anew:
            for key in sorted(self._shown - items.keys()):
                self.changes.put(key, None)
        self._shown |= items.keys()
        for key, value in items.items():
            self.changes.put(key, value)
        self.changes.put("playback", self._playback())
        return self.changes.version != before

    def _playback(self) -> dict[str, Any]:
        playback = self.playback
        return {
            "at_s": self.seconds(playback.at_us),
            "paused": playback.is_paused,
            "speed": playback.speed,
        }

    def to_json(self) -> dict[str, Any]:
        """What is known of it once: whose it is, and from when to when it goes."""
        recording, player = self.playback.player.recording, self.playback.player
        return {
            "file": recording.name,
            "robot": recording.metadata.robot or None,
            "run": recording.metadata.run,
            "from_s": self.seconds(player.begin_us),
            "to_s": self.seconds(player.end_us),
        }
