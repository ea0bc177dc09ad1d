"""Recordings of real processes. A full disk, or their limit, ends them, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import MessageKind
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


class RobotRecording:
    """What one robot's process records; `log` is told if it ends early."""

    def __init__(self, recorder: RobotRecorder, log: Callable[..., None]) -> None:
        self._recorder: RobotRecorder | None = recorder
        self._log = log

    def step(self, event: Input, effects: Sequence[Effect], now_us: int) -> None:
        """The agent has taken in an input, and wants these effects."""
        if self._recorder is not None:
            try:
                self._recorder.step(event, effects, now_us)
            except OSError as error:
                self._give_up(error)

    def close(self) -> None:
        """End the recording."""
        if self._recorder is not None:
            try:
                self._recorder.close()
            except OSError as error:
                self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        if self._recorder is not None:
            self._recorder.abandon()
            self._recorder = None
        self._log("error", "recording_ended", reason=error.strerror or str(error))


class ObserverRecording:
    """What one who watches records; `say` is told if it ends early."""

    def __init__(self, recorder: ObserverRecorder, say: Callable[[int, str], None]) -> None:
        self._recorder: ObserverRecorder | None = recorder
        self._say = say

    def message(self, kind: MessageKind, source: str, data: bytes, now_us: int) -> None:
        """A message has been taken in."""
        self._do(now_us, lambda recorder: recorder.message(kind, source, data, now_us))

    def update(self, now_us: int) -> None:
        """The observer has been brought up to date."""
        self._do(now_us, lambda recorder: recorder.update(now_us))

    def close(self) -> None:
        """End the recording."""
        self._do(boottime_us(), ObserverRecorder.close)

    def _do(self, now_us: int, step: Callable[[ObserverRecorder], None]) -> None:
        if self._recorder is not None:
            try:
                step(self._recorder)
            except OSError as error:
                self._recorder.abandon()
                self._recorder = None
                self._say(now_us, f"nothing is recorded any more: {error.strerror or error}")


def robot_recording(
    options: RobotOptions,
    mission: Mission,
    config: AgentConfig,
    view: AgentView,
    log: Callable[..., Any],
) -> RobotRecording | None:
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
        writer = RecordingWriter(path, metadata, options.keep_bytes, beats=beats)
        recorder = RobotRecorder(writer, view, boottime_us(), beats=beats)
    except OSError as error:
        raise InputError(_cannot(path, error)) from None
    return RobotRecording(recorder, log)


def observer_recording(
    to: RecordTo | None,
    observer: Observer,
    run: str,
    has_keys: bool,
    say: Callable[[int, str], None],
) -> ObserverRecording | None:
    """Begin to record what an observer hears; raises InputError if that cannot be."""
    if to is None:
        return None
    metadata = replace(observer_metadata(observer, run, has_keys), speed=to.speed)
    try:
        writer = RecordingWriter(to.path, metadata, to.limit_bytes, beats=to.beats)
    except OSError as error:
        raise InputError(_cannot(to.path, error)) from None
    return ObserverRecording(ObserverRecorder(writer, observer, beats=to.beats), say)


def observer_metadata(observer: Observer, run: str, has_keys: bool) -> RunMetadata:
    """What the recording of one who watches says of itself."""
    found = _metadata(observer.mission, OBSERVER, run, observer.membership.timing)
    return replace(found, has_keys=has_keys)


def _metadata(mission: Mission, robot: str, run: str, timing: Timing) -> RunMetadata:
    epoch_ns = time.time_ns() - boottime_us() * 1_000
    return RunMetadata.of(mission, robot, run, timing, epoch_ns, __version__)


def _cannot(path: Path, error: OSError) -> str:
    return f"--record {path}: cannot be written: {error.strerror or error}"
