"""What the robots of a simulated run record, and its observer: the same as real ones do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.folder import earlier_files, observer_file, robot_file
from mrbt_mesh.recording.metadata import OBSERVER, RunMetadata
from mrbt_mesh.recording.observer_recorder import ObserverRecorder
from mrbt_mesh.recording.reader import named
from mrbt_mesh.recording.robot_recorder import RobotRecorder
from mrbt_mesh.recording.writer import RecordingWriter
from mrbt_mesh.sim.world.setup import Setup
from mrbt_mesh.version import __version__


class Recordings:
    """The recordings of one run, in one folder; all times are the world's, from 0."""

    def __init__(self, setup: Setup, folder: Path, observer: Observer) -> None:
        self._setup = setup
        self._folder = folder
        self._open: list[RobotRecorder | ObserverRecorder] = []
        writer = self._writer(observer_file(folder), OBSERVER)
        self._observer = ObserverRecorder(writer, observer)
        self._open.append(self._observer)

    def _writer(self, path: Path, robot: str) -> RecordingWriter:
        setup = self._setup
        found = RunMetadata.of(setup.mission, robot, setup.run, setup.timing, 0, __version__)
        keys = setup.agents.keys.get(robot)
        has_keys = keys is not None
        metadata = replace(
            found,
            speed=setup.speed,
            has_keys=has_keys,
            is_observed=True,
            earlier=named(earlier_files(path), setup.run),
        )
        return RecordingWriter(path, metadata, setup.agents.record_limit_bytes, keys=keys)

    def begin(self, view: AgentView, now_us: int) -> RobotRecorder:
        """Record a process of a robot from its start on."""
        path = robot_file(self._folder, view.robot)
        recorder = RobotRecorder(self._writer(path, view.robot), view, now_us)
        self._open.append(recorder)
        return recorder

    def observed(self, now_us: int) -> None:
        """The observer has been brought up to date."""
        self._observer.update(now_us)

    def close(self) -> None:
        """End all recordings: the run is over."""
        for recorder in self._open:
            recorder.close()
