"""The recording of a real process. A full disk ends it, and nothing else."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Generic, TypeVar

from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import earlier_files
from mrbt_mesh.recording.metadata import RunMetadata
from mrbt_mesh.recording.reader import named
from mrbt_mesh.recording.recorder import Recorder
from mrbt_mesh.recording.robot_recorder import RobotRecorder
from mrbt_mesh.recording.writer import RecordingWriter
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.process_identity import clock_id
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.version import __version__

DISK_TROUBLES = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)
_Recorder = TypeVar("_Recorder", bound=Recorder)


class GuardedRecorder(Generic[_Recorder]):
    """A recorder that stops when its disk is full; `report` gets the reason.

    `recorder` is None once it has stopped, or if it could not begin; then `why_not_begun` is the
    reason.
    """

    def __init__(
        self,
        recorder: _Recorder | None,
        report: Callable[[str], None],
        why_not_begun: str = "",
    ) -> None:
        self.recorder = recorder
        self.why_not_begun = why_not_begun
        self._report = report

    def do(self, step: Callable[[_Recorder], None]) -> None:
        """Call `step` with the recorder, if it still records."""
        if self.recorder is not None:
            try:
                step(self.recorder)
            except OSError as error:
                self.recorder.abandon()
                self.recorder = None
                self._report(error.strerror or str(error))

    def close(self) -> None:
        """End the recording."""
        self.do(lambda recorder: recorder.close())


def robot_recording(
    options: RobotOptions,
    mission: Mission,
    config: AgentConfig,
    view: AgentView,
    ended: Callable[[str], None],
) -> GuardedRecorder[RobotRecorder] | None:
    """Begin to record a robot, before its first step. Raises InputError for an unusable file.

    `ended` gets the reason if it cannot continue. A disk that is full, or temporarily not writable,
    does not keep a robot from its work.
    """
    path, beats = options.record, options.record_beats
    if path is None:
        return None
    metadata = metadata_of(mission, config.robot, config.run, config.timing)
    metadata = replace(
        metadata,
        solver=options.solver or "",
        has_keys=config.keys is not None,
        speed=options.speed,
        is_observed=options.while_locked is not None,
        earlier=named(earlier_files(path), config.run),
    )
    try:
        writer = RecordingWriter(path, metadata, options.keep_bytes, beats=beats, keys=config.keys)
        recorder = RobotRecorder(writer, view, boottime_us(), beats=beats)
    except OSError as error:
        if error.errno not in DISK_TROUBLES:
            raise InputError(cannot_record(path, error)) from None
        return GuardedRecorder(None, ended, error.strerror or str(error))
    return GuardedRecorder(recorder, ended)


def metadata_of(mission: Mission, robot: str, run: str, timing: Timing) -> RunMetadata:
    """Return the metadata of a recording that begins now."""
    epoch_ns = time.time_ns() - boottime_us() * 1_000
    metadata = RunMetadata.of(mission, robot, run, timing, epoch_ns, __version__)
    return replace(metadata, clock=clock_id())


def cannot_record(path: Path, error: OSError) -> str:
    """Return the message for a file that cannot be written."""
    return f"--record {path}: cannot be written: {error.strerror or error}"
