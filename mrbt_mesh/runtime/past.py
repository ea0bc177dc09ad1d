"""Tells what happened in a run before an observer came, from the recordings in its folder."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.folder import first_parts, observer_files, robot_files
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, RecordingError, open_recording
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.process_identity import is_this_clock
from mrbt_mesh.runtime.solver_loader import chosen_engine

# Recordings that begin within this time of the first count as beginning with it.
BEGINS_WITHIN_US = 1_000_000
# If other recordings extend this much later, the observer has ended.
STILL_WRITTEN_US = 10_000_000


def tell_past(
    observer: Observer, run_dir: Path, started_unix_s: float, living: Collection[str]
) -> int | None:
    """Feed an observer that hears nothing yet with the recordings of its run.

    Returns until when the run was recorded, in microseconds of this machine's clock; None if it was
    not recorded at all. `living` are the robots whose processes run now; recordings by them and by
    their launcher are complete until now, even if nothing has happened for a while. Where one
    recording ends, e.g. that of a robot that died, another one continues. Gaps between
    `started_unix_s` and now that no recording covers are noted as not watched.
    """
    record = observer.record
    found, problem = _recordings(observer, run_dir, living)
    until_us: int | None = None
    while record.result is None and (best := _next(found, until_us)) is not None:
        found.remove(best)
        try:
            until_us = _tell(observer, best, until_us)
        except RecordingError as error:
            problem = problem or str(error)
    if until_us is None and problem:
        record.say(boottime_us(), f"what happened before is not known: {problem}")
    if record.started_us is None:
        record.started_us = round(started_unix_s * 1e6) - _epoch_us()
    if record.result is None:
        observer.watch_from(boottime_us(), record.started_us if until_us is None else until_us)
    return until_us


@dataclass(frozen=True)
class LastRecord:
    """The last record of a robot: its time on this machine's clock.

    `is_end`: the robot has ended its recording itself.
    """

    at_us: int
    is_end: bool


def last_records(observer: Observer, run_dir: Path) -> dict[str, LastRecord]:
    """Return the last record of each robot that has recorded this run."""
    told, _ = _recordings(observer, run_dir, ())
    found: dict[str, LastRecord] = {}
    for each in sorted(told, key=lambda each: each.end_us):
        is_end = each.recording.cut_off_at is None
        found[each.recording.metadata.robot] = LastRecord(each.end_us, is_end)
    return {robot: last for robot, last in found.items() if robot}


@dataclass(frozen=True)
class _Told:
    """One recording of the run, complete until `until_us`."""

    recording: Recording
    end_us: int
    until_us: int

    @property
    def is_observers(self) -> bool:
        """True for an observer's recording: it heard all robots, and knows when processes ended."""
        return not self.recording.metadata.robot


def _epoch_us() -> int:
    """The Unix time at which this machine's clock was 0."""
    return round(time.time() * 1e6) - boottime_us()


def _recordings(
    observer: Observer, run_dir: Path, living: Collection[str]
) -> tuple[list[_Told], str]:
    """Return the recordings of the run, and why one cannot be read."""
    found, problem, wanted = [], "", (observer.facts.run, observer.mission.team_digest)
    for path in first_parts([*observer_files(run_dir), *robot_files(run_dir)]):
        try:
            recording = open_recording(path)
        except RecordingError as error:
            problem = problem or str(error)
            continue
        said = recording.metadata
        if (said.run, said.team_digest) != wanted or not recording.records:
            continue
        # It may be from another machine, or from before this one rebooted.
        is_same = is_this_clock(said.clock)
        ahead_us = 0 if is_same else said.epoch_ns // 1_000 - _epoch_us()
        records = recording.records.shifted(ahead_us)
        end_us = max(records.times_us)
        found.append(_Told(replace(recording, records=records), end_us, end_us))
    return [_until_now(told, found, living) for told in found], problem


def _until_now(told: _Told, found: Sequence[_Told], living: Collection[str]) -> _Told:
    """Extend a recording that is still written until now; one of an earlier process has ended."""
    robot = told.recording.metadata.robot
    if robot:
        is_written = robot in living
        ends = [each.end_us for each in found if each.recording.metadata.robot == robot]
    else:
        is_written = bool(living)
        ends = [each.end_us - STILL_WRITTEN_US for each in found]
    if told.recording.cut_off_at is None or not is_written or told.end_us < max(ends):
        return told
    return replace(told, until_us=boottime_us())


def _next(found: Sequence[_Told], until_us: int | None) -> _Told | None:
    """Return the recording that continues where the previous ones end; None if there is none."""
    later = [each for each in found if until_us is None or each.end_us > until_us]
    if not later:
        return None
    first_us = min(each.recording.begin_us for each in later)
    begin_us = max(first_us, until_us or first_us) + BEGINS_WITHIN_US
    begun = [each for each in later if each.recording.begin_us <= begin_us]
    return max(begun, key=lambda each: (each.is_observers, each.end_us, each.recording.path))


def _tell(observer: Observer, told: _Told, known_until_us: int | None) -> int:
    """Play one recording to the observer; return until when everything is known.

    Raises RecordingError.
    """
    begin_us = told.recording.begin_us
    if known_until_us is not None and begin_us > known_until_us + BEGINS_WITHIN_US:
        observer.watch_from(begin_us, known_until_us)
        observer.record.is_catching_up = False

    def begun(mission: Mission) -> Observer:
        """The mission in force now may be a later revision."""
        if not observer.facts.map:
            observer.begin_with(mission)
        return observer

    player = Player(told.recording, begun, chosen_engine(), known_until_us)
    player.seek(player.end_us)
    return told.until_us
