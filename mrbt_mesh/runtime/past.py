"""What happened in a run before somebody came to watch it, from the recordings in its folder."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.recording.folder import first_parts, observer_files, parts_of, robot_files
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import RecordingError, open_recording
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.solver_loader import chosen_engine

# What was written so much later than another one is the one that goes on.
STILL_WRITTEN_S = 10.0


def tell_past(
    observer: Observer, run_dir: Path, started_unix_s: float, living: Collection[str]
) -> None:
    """Tell an observer that hears nothing yet what was recorded of its run, which began then.

    `living`: the robots whose processes run now; what they and who launched them record is whole
    until now, also where nothing has happened for a while. What no recording holds, from the
    start of the run until now, is noted as not watched.
    """
    epoch_us = round(time.time() * 1e6) - boottime_us()
    record, until_us, problem = observer.record, None, ""
    for path in _by_worth(run_dir):
        try:
            until_us = _tell(observer, path, epoch_us, living)
        except RecordingError as error:
            problem = problem or str(error)
        if until_us is not None:
            break
    if until_us is None and problem:
        record.say(boottime_us(), f"what happened before is not known: {problem}")
    if record.started_us is None:
        record.started_us = round(started_unix_s * 1e6) - epoch_us
    if record.result is None:
        observer.watch_from(boottime_us(), record.started_us if until_us is None else until_us)


def _tell(observer: Observer, path: Path, epoch_us: int, living: Collection[str]) -> int | None:
    """The time of the recording's end; None if it is empty, or of another run.

    `epoch_us`: the Unix time at which this machine's clock was 0. Raises RecordingError.
    """
    recording = open_recording(path)
    said = recording.metadata
    is_of_run = (said.run, said.team_digest) == (observer.facts.run, observer.mission.team_digest)
    if not is_of_run or not recording.records:
        return None
    # It may be of another machine, or of before this one was started again.
    shift_us = said.epoch_ns // 1_000 - epoch_us
    recording = replace(recording, records=recording.records.shifted(shift_us))
    now_us = boottime_us()
    player = Player(recording, lambda: observer, chosen_engine())
    player.seek(player.end_us)
    is_whole = recording.cut_off_at is not None and (said.robot in living or not said.robot)
    return now_us if is_whole and living else player.end_us


def _by_worth(run_dir: Path) -> Iterator[Path]:
    """The recordings of a folder, the fullest first.

    An observer has heard all robots; of robots, the one that was there longest comes first.
    """
    watched, robots = (
        {path: [each.stat() for each in parts_of(path)] for path in first_parts(files)}
        for files in (observer_files(run_dir), robot_files(run_dir))
    )
    found = {**watched, **robots}
    times = {path: max(each.st_mtime for each in found[path]) for path in found}
    newest = max(times.values(), default=0.0)
    fresh = [path for path in times if times[path] > newest - STILL_WRITTEN_S]
    for some in (watched, robots):
        sizes = {path: sum(each.st_size for each in some[path]) for path in some if path in fresh}
        yield from sorted(sizes, key=lambda path: -sizes[path])
    yield from sorted((p for p in times if p not in fresh), key=lambda p: -times[p])
