"""Recordings of processes: what cannot be written ends the recording, and nothing else."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.inputs import PositionReported, TimerFired
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.folder import number_of_part, parts_of
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.recording.writer import RecordingWriter
from mrbt_mesh.runtime import recording as recording_module
from mrbt_mesh.runtime.observer_recording import RecordTo, observer_recording
from mrbt_mesh.runtime.recording import robot_recording
from mrbt_mesh.runtime.robot_options import RobotOptions
from tests.support.build import action, make_mission
from tests.support.keys import keys_of

MISSION = make_mission(action("a1"))
CONFIG = AgentConfig(
    robot="R1", type="T", capabilities={"a1": 1}, run="r1", nonce="n1", solver=default_solver
)


def record(recording: Any, agent: Agent, event: Any, now_us: int) -> None:
    effects = agent.handle(event, now_us)
    recording.do(lambda recorder: recorder.step(event, effects, now_us))


def full(*_: Any) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_ends_the_recording_and_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    agent = Agent(MISSION, CONFIG, 0)
    to = RobotOptions(record=tmp_path / "a.mcap", solver="mine", speed=2.0)
    recording = robot_recording(to, MISSION, CONFIG, agent.view, told.append)
    assert recording is not None
    for now_us in (1_000, 2_000_000, 4_000_000):
        record(recording, agent, TimerFired(), now_us)
    with monkeypatch.context() as broken:
        broken.setattr(RecordingWriter, "flush", full)
        broken.setattr(RecordingWriter, "write", full)
        for now_us in (6_000_000, 8_000_000):
            record(recording, agent, TimerFired(), now_us)
    recording.close()
    assert told == ["No space left on device"]
    found = read_recording(tmp_path / "a.mcap")
    assert (found.metadata.robot, found.metadata.solver, found.metadata.speed) == ("R1", "mine", 2)
    assert {each.topic for each in found.records} >= {"/facts", "/plans", "/life"}
    assert found.damage == ()


def test_one_who_watches_says_that_nothing_is_recorded_any_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    observer = Observer(MISSION, "r1", Timing(), default_solver)
    to = RecordTo(tmp_path / "run.mcap")
    recording = observer_recording(to, observer, "r1", keys_of("A")["op"])
    recording.do(lambda recorder: recorder.update(1))
    monkeypatch.setattr(RecordingWriter, "flush", full)
    recording.do(lambda recorder: recorder.update(2))
    recording.do(lambda recorder: recorder.update(3))
    recording.close()
    said = [text for _, text in observer.record.timeline]
    assert said == ["nothing is recorded any more: No space left on device"]
    metadata = read_recording(to.path).metadata
    assert (metadata.robot, metadata.has_keys) == ("", True)


def test_a_place_that_cannot_be_written_is_bad_input(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    agent = Agent(MISSION, CONFIG, 0)
    with pytest.raises(InputError, match=r"--record .*file/a\.mcap: cannot be written: "):
        robot_recording(RobotOptions(record=file / "a.mcap"), MISSION, CONFIG, agent.view, full)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_a_disk_that_is_full_keeps_no_robot_from_its_work(
    tmp_path: Path, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(recording_module, "RecordingWriter", refused)
    agent = Agent(MISSION, CONFIG, 0)
    to = RobotOptions(record=tmp_path / "a.mcap")
    recording = robot_recording(to, MISSION, CONFIG, agent.view, full)
    assert recording is not None
    assert (recording.recorder, recording.why_not_begun) == (None, os.strerror(number))
    record(recording, agent, TimerFired(), 0)
    recording.close()


def test_nothing_is_recorded_where_nothing_is_asked_for() -> None:
    agent = Agent(MISSION, CONFIG, 0)
    assert robot_recording(RobotOptions(), MISSION, CONFIG, agent.view, full) is None


def test_heartbeats_are_recorded_on_request(tmp_path: Path) -> None:
    agent = Agent(MISSION, CONFIG, 0)
    to = RobotOptions(record=tmp_path / "a.mcap", record_beats=True)
    recording = robot_recording(to, MISSION, CONFIG, agent.view, full)
    assert recording is not None
    for now_us in range(0, 4_000_000, 200_000):
        record(recording, agent, TimerFired(), now_us)
    recording.close()
    beats = [
        each.data for each in read_recording(tmp_path / "a.mcap").records if each.topic == "/beats"
    ]
    assert len(beats) >= 3
    assert all(each["source"] == "R1" and each["sent"] for each in beats)


def test_a_long_recording_keeps_its_last_parts(tmp_path: Path) -> None:
    told: list[str] = []
    agent = Agent(MISSION, CONFIG, 0)
    path = tmp_path / "a.mcap"
    to = RobotOptions(record=path, keep_mib=1)
    recording = robot_recording(to, MISSION, CONFIG, agent.view, told.append)
    assert recording is not None
    now_us, last = 0, path.with_name("a.part20.mcap")
    for step in range(100_000):
        now_us = step * 100_000
        record(recording, agent, PositionReported(Position(now_us, 0, None)), now_us)
        if last.exists():
            break
    recording.close()
    assert not told
    parts = parts_of(path)
    assert last in parts
    assert path not in parts, "the first ones are removed"
    assert sum(each.stat().st_size for each in parts) <= 1 << 20
    found = read_recording(path)
    assert found.damage == ()
    assert found.metadata.part == number_of_part(parts[0])
    assert "what was before is not kept" in found.begins_late
