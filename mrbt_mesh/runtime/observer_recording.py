"""The recording of an observer of real processes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.folder import earlier_files, first_parts, robot_files
from mrbt_mesh.recording.metadata import OBSERVER, RunMetadata
from mrbt_mesh.recording.observer_recorder import ObserverRecorder
from mrbt_mesh.recording.reader import named
from mrbt_mesh.recording.writer import RecordingWriter
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.limited_file import DEFAULT_KEEP_BYTES
from mrbt_mesh.runtime.recording import GuardedRecorder, cannot_record, metadata_of
from mrbt_mesh.runtime.run_dir import RunDir


@dataclass(frozen=True)
class RecordTo:
    """Where an observer records; with `beats`, every heartbeat as well.

    `speed`: how many times faster simulated robots work. `limit_bytes`: the size at which the
    recording ends. `has_summary`: the observer writes summary.json at the end of the run.
    """

    path: Path
    beats: bool = False
    speed: float = 1.0
    limit_bytes: int = DEFAULT_KEEP_BYTES
    has_summary: bool = False


def observer_recording(
    to: RecordTo,
    observer: Observer,
    run: str,
    keys: Keys | None,
) -> GuardedRecorder[ObserverRecorder]:
    """Begin to record what an observer hears. Raises InputError if that is impossible."""
    metadata = replace(
        observer_metadata(observer, run, keys is not None),
        speed=to.speed,
        has_summary=to.has_summary,
        earlier=named(
            [*earlier_files(to.path), *first_parts(robot_files(to.path.parent))],
            run,
            RunDir(to.path.parent).robots(),
        ),
    )
    try:
        writer = RecordingWriter(to.path, metadata, to.limit_bytes, beats=to.beats, keys=keys)
    except OSError as error:
        raise InputError(cannot_record(to.path, error)) from None
    return to_observers_record(ObserverRecorder(writer, observer, beats=to.beats), observer)


def to_observers_record(
    recorder: ObserverRecorder, observer: Observer
) -> GuardedRecorder[ObserverRecorder]:
    """Guard a recorder; the end of its recording becomes an entry of the observer's record."""

    def report(reason: str) -> None:
        observer.record.say(boottime_us(), f"nothing is recorded any more: {reason}")

    return GuardedRecorder(recorder, report)


def observer_metadata(observer: Observer, run: str, has_keys: bool) -> RunMetadata:
    """Return the metadata of an observer's recording."""
    found = metadata_of(observer.mission, OBSERVER, run, observer.membership.timing)
    return replace(found, has_keys=has_keys)
