"""Recordings of real processes. A full disk, or their limit, ends them, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.metadata import OBSERVER, RunMetadata
from mrbt_mesh.recording.observer_recorder import ObserverRecorder
from mrbt_mesh.recording.robot_recorder import RobotRecorder
from mrbt_mesh.recording.writer import RecordingWriter
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.limited_file import DEFAULT_KEEP_BYTES
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.version import __version__


@dataclass(frozen=True)
class RecordTo:
    """Where an observer records; with `beats` also every heartbeat.

    `speed`: how many times faster simulated robots work. `limit_bytes`: the recording ends there.
    """

    path: Path
    beats: bool = False
    speed: float = 1.0
    limit_bytes: int = DEFAULT_KEEP_BYTES


_Recorder = TypeVar("_Recorder", RobotRecorder, ObserverRecorder)


class GuardedRecorder(Generic[_Recorder]):
    """A recorder that a full disk, or the limit of its file, ends; `report` gets the reason."""

    def __init__(self, recorder: _Recorder, report: Callable[[str], None]) -> None:
        self._recorder: _Recorder | None = recorder
        self._report = report

    def do(self, step: Callable[[_Recorder], None]) -> None:
        """Record with the recorder, if it still records."""
        if self._recorder is not None:
            try:
                step(self._recorder)
            except OSError as error:
                self._recorder.abandon()
                self._recorder = None
                self._report(error.strerror or str(error))

    def close(self) -> None:
        """End the recording."""
        self.do(lambda recorder: recorder.close())


def robot_recording(
    options: RobotOptions,
    mission: Mission,
    config: AgentConfig,
    view: AgentView,
    log: Callable[..., Any],
) -> GuardedRecorder[RobotRecorder] | None:
    """Begin to record a robot, before its first step; raises InputError if that cannot be."""
    path, beats = options.record, options.record_beats
    if path is None:
        return None
    metadata = _metadata(mission, config.robot, config.run, config.timing)
    metadata = replace(
        metadata,
        solver=options.solver or "",
        has_keys=config.keys is not None,
        speed=options.speed,
    )
    try:
        writer = RecordingWriter(path, metadata, options.keep_bytes, beats=beats, keys=config.keys)
        recorder = RobotRecorder(writer, view, boottime_us(), beats=beats)
    except OSError as error:
        raise InputError(_cannot(path, error)) from None
    return GuardedRecorder(recorder, lambda reason: log("error", "recording_ended", reason=reason))


def observer_recording(
    to: RecordTo | None,
    observer: Observer,
    run: str,
    keys: Keys | None,
) -> GuardedRecorder[ObserverRecorder] | None:
    """Begin to record what an observer hears; raises InputError if that cannot be."""
    if to is None:
        return None
    metadata = replace(observer_metadata(observer, run, keys is not None), speed=to.speed)
    try:
        writer = RecordingWriter(to.path, metadata, to.limit_bytes, beats=to.beats, keys=keys)
    except OSError as error:
        raise InputError(_cannot(to.path, error)) from None
    return to_observers_record(ObserverRecorder(writer, observer, beats=to.beats), observer)


def to_observers_record(
    recorder: ObserverRecorder, observer: Observer
) -> GuardedRecorder[ObserverRecorder]:
    """A recording whose end is an entry of the observer's own record."""

    def report(reason: str) -> None:
        observer.record.say(boottime_us(), f"nothing is recorded any more: {reason}")

    return GuardedRecorder(recorder, report)


def observer_metadata(observer: Observer, run: str, has_keys: bool) -> RunMetadata:
    """The metadata of an observer's recording."""
    found = _metadata(observer.mission, OBSERVER, run, observer.membership.timing)
    return replace(found, has_keys=has_keys)


def _metadata(mission: Mission, robot: str, run: str, timing: Timing) -> RunMetadata:
    epoch_ns = time.time_ns() - boottime_us() * 1_000
    return RunMetadata.of(mission, robot, run, timing, epoch_ns, __version__)


def _cannot(path: Path, error: OSError) -> str:
    return f"--record {path}: cannot be written: {error.strerror or error}"
