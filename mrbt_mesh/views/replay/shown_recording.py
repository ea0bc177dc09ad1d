"""A recording as shown by views: its whole timeline, and the team at one time of it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import Any

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.recording.player import Player
from mrbt_mesh.views.model.changes import ChangeLog
from mrbt_mesh.views.model.team_view import TakeoversView, TeamState
from mrbt_mesh.views.model.timeline import TimelineView

SLOWEST, FASTEST = 0.01, 1000.0
# How much of the timeline is read before anything is shown: about a second of work.
FIRST_RECORDS = 2_000


class Playback:
    """The position in a recording. `at_us` is always within it; `catch_up` brings the player there.

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
        """True if nothing is left to play."""
        return self.at_us == self.player.end_us

    def go_to(self, at_us: int) -> None:
        """Go there, or to the nearest time of the recording."""
        self.at_us = min(max(at_us, self.player.begin_us), self.player.end_us)

    def set_speed(self, speed: float) -> None:
        """Play at this multiple of real time, limited to the bounds."""
        self.speed = min(max(speed, SLOWEST), FASTEST)

    def passed(self, seconds: float) -> None:
        """Advance by a time of the viewer, unless it is paused."""
        if not self.is_paused:
            self.go_to(self.at_us + round(seconds * self.speed * SECOND_US))

    def catch_up(self) -> None:
        """Bring the player to `at_us`. Raises RecordingError if that cannot be played."""
        for _ in self.player.play_to(self.at_us, skips=True):
            pass


class ShownRecording:
    """A recording as it is shown.

    `changes` has the items of a `TeamView`: those of the timeline for the part that was `read`, the
    others for the team at the position of `playback`. It also has `playback`: that position in
    seconds, and `read_s`, up to where the timeline is read; None: all of it. Times count from the
    start of the run, as on a live page, so the recording may begin before 0. Raises RecordingError
    if it is damaged.
    """

    def __init__(self, player: Player, at_us: int, speed: float) -> None:
        self.changes = ChangeLog()
        # Plays the whole recording once, for the timeline.
        self._reader = Player(player.recording)
        self._timeline = TimelineView(self._reader.observer)
        self._reading = self._read_on()
        self._is_read = False
        record = self._reader.observer.record
        while not self.read(FIRST_RECORDS) and record.started_us is None:
            pass
        self._start_us = player.begin_us if record.started_us is None else record.started_us
        self.playback = Playback(player, at_us, speed)
        self.playback.catch_up()
        self._begin_state()
        self._shown: set[str] = set()

    def _read_on(self) -> Iterator[None]:
        """Read the timeline, record by record."""
        reader, times_us = self._reader, self._reader.recording.records.times_us
        takeovers = TakeoversView(reader.observer)
        for number, _ in enumerate(reader.play_to(reader.end_us), 1):
            # Records with the same time belong to one step.
            if number == len(times_us) or times_us[number] != times_us[number - 1]:
                takeovers.put(self.changes)
            yield

    def read(self, records: int) -> bool:
        """Read the timeline of `records` more records; return whether all of it is read now."""
        if not self._is_read:
            self._is_read = sum(1 for _ in islice(self._reading, records)) < records
            self._timeline.put(self.changes)
        return self._is_read

    def read_all(self) -> None:
        """Read all of the timeline."""
        self.read(len(self._reader.recording.records) + 1)

    @property
    def read_s(self) -> float | None:
        """Up to where the timeline is read, in seconds from the start of the run.

        None: all of it.
        """
        return None if self._is_read else self.seconds(self._reader.now_us)

    @property
    def whole(self) -> RunRecord:
        """The record of the recording as far as it is read."""
        return self._reader.observer.record

    def _begin_state(self) -> None:
        self._state = TeamState(self.observer, ChangeLog())
        self._taken = 0

    @property
    def observer(self) -> Observer:
        """The team at the current position."""
        return self.playback.player.observer

    def seconds(self, at_us: int) -> float:
        """Return a time of the recording in seconds from the start of the run."""
        return round((at_us - self._start_us) / SECOND_US, 6)

    def go_to(self, at_s: float) -> None:
        """Go to a time in seconds from the start of the run."""
        self.playback.go_to(self._start_us + round(at_s * SECOND_US))

    def play(self, is_paused: bool) -> None:
        """Pause, or play; at the end, play from the beginning."""
        playback = self.playback
        playback.is_paused = is_paused
        if not is_paused and playback.is_at_end:
            playback.go_to(playback.player.begin_us)

    def passed(self, seconds: float) -> None:
        """Advance by a time of the viewer; it pauses at the end."""
        self.playback.passed(seconds)
        self.playback.is_paused |= self.playback.is_at_end

    def step(self, records: int) -> bool:
        """Play at most `records` records; return whether the player has caught up.

        The caller serves pages in between, because large plans take long to compute.
        """
        playing = self.playback.player.play_to(self.playback.at_us, skips=True)
        for count, _ in enumerate(playing, 1):
            if self._state.observer is not self.observer:
                self._begin_state()  # it went back
            self._state.count_activations()
            if count == records:
                return False
        return True

    def update(self, now_us: int) -> bool:
        """Bring `changes` up to date; return whether anything has changed."""
        before = self.changes.version
        if self._state.observer is not self.observer:
            self._begin_state()
        self._state.update(now_us)
        since = self._state.changes.start_of(self._taken)
        is_anew, items = since == 0, self._state.changes.since(since)
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
            "read_s": self.read_s,
        }

    def to_json(self) -> dict[str, Any]:
        """Return the constant properties: its owner, its begin and end, whether the end is torn."""
        recording, player = self.playback.player.recording, self.playback.player
        return {
            "file": recording.name,
            "robot": recording.metadata.robot or None,
            "run": recording.metadata.run,
            "from_s": self.seconds(player.begin_us),
            "to_s": self.seconds(player.end_us),
            "torn": recording.torn or None,
        }
