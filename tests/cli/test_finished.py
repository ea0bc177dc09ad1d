"""Which summary is that of the run: of one that was resumed, and has not ended, there is none."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.cli import finished
from mrbt_mesh.cli.finished import summary_of_finished
from mrbt_mesh.cli.options import chosen_robots
from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.recording.folder import observer_file, robot_files
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.runtime.command_log import note_command
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.launcher_lock import launched_from_here
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import SIGNATURE_FILE, RunDir
from mrbt_mesh.runtime.summary_signature import parse_signature
from mrbt_mesh.runtime.team import new_run
from mrbt_mesh.sim import Kill
from tests.support.paths import mission_file
from tests.support.recorded import record_example

# As the simulation of seed 1 is called.
RUN = "sim1"


@pytest.fixture
def run_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunDir:
    """That of a run in which no robot was started."""
    path = mission_file("explore")
    mission = load_mission(path)
    robots = chosen_robots("--robots", None, mission)
    info = new_run(mission, path, robots, RobotOptions(beat_s=1.0, detection_s=5.0))
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    return RunDir.create(
        tmp_path / "run",
        replace(info, options=replace(info.options, run=RUN)),
        compile_mission(mission),
    )


def begin(run_dir: RunDir, robot: str) -> Path:
    """A robot whose process has gone; the file that says when it lived last."""
    path = run_dir.path / f"{robot}.process"
    path.write_text('{"pid": 1, "started": ""}')
    return path


def test_a_run_that_nobody_watched_has_a_summary(run_dir: RunDir) -> None:
    assert summary_of_finished(run_dir) is None, "no robot was ever started"
    begin(run_dir, "R1")
    with launched_from_here(run_dir):
        assert summary_of_finished(run_dir) is None, "its launcher will write it"
    found = summary_of_finished(run_dir)
    assert found is not None
    assert (found["result"], found["ended_because"]) == ("blocked", "no robot is left")
    assert run_dir.summary() == found
    before_s = run_dir.info().started_unix_s - 3_600
    os.utime(run_dir.path / "summary.json", (before_s, before_s))
    assert run_dir.summary() == found, "after a step of the clock"


def test_an_end_that_was_told_too_late_is_not_that_of_what_goes_on(
    run_dir: RunDir, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the summary is made the run is continued."""
    begin(run_dir, "R1")
    make = finished._summary

    def made_slowly(of: RunDir) -> dict[str, Any]:
        summary = make(of)
        info = of.info()
        of.save(replace(info, started_unix_s=info.started_unix_s + 1))
        return summary

    with monkeypatch.context() as slow:
        slow.setattr(finished, "_summary", made_slowly)
        assert summary_of_finished(run_dir) is None
    assert run_dir.summary() is None
    assert summary_of_finished(run_dir) is not None


@pytest.mark.parametrize(
    ("commands", "result", "because"),
    [
        ([], "blocked", "no robot is left"),
        ([("mrbt down", "ended by anna")], "ended", "ended by anna"),
        (
            [("mrbt down", "ended by anna"), ("mrbt join", "R1 joined")],
            "blocked",
            "no robot is left",
        ),
    ],
)
def test_a_run_that_an_operator_has_ended_says_by_whom(
    run_dir: RunDir, commands: list[tuple[str, str]], result: str, because: str
) -> None:
    begin(run_dir, "R1")
    for by, what in commands:
        note_command(run_dir, by, what)
    found = summary_of_finished(run_dir)
    assert found is not None
    assert (found["result"], found["ended_because"]) == (result, because)


def test_a_run_ends_no_earlier_than_what_was_recorded_of_it(run_dir: RunDir) -> None:
    killed = [(2_000_000, Kill("R1")), (2_500_000, Kill("R2"))]
    record_example(run_dir.path, "explore", 1, killed)
    os.utime(begin(run_dir, "R1"), (1.0, 1.0))
    found = summary_of_finished(run_dir)
    assert found is not None
    assert found["duration_s"] == pytest.approx(2.5, abs=1)


@pytest.mark.parametrize(("down_after_s", "state"), [(None, "dead"), (1.0, "left"), (60.0, "dead")])
def test_deaths_that_nobody_saw_are_faults_too(
    run_dir: RunDir, down_after_s: float | None, state: str
) -> None:
    """As robots have no time to tell of when all are killed; but the end of the team is none."""
    record_example(run_dir.path, "explore", 1, [(2_000_000, Kill("R1")), (2_000_000, Kill("R2"))])
    observer_file(run_dir.path).unlink()
    ends = {}
    for path in robot_files(run_dir.path):
        recording = read_recording(path)
        end_us = recording.metadata.epoch_ns // 1_000 + recording.records[-1].at_us
        ends[recording.metadata.robot] = end_us / 1e6
        # Whoever copies a run directory changes its files' times.
        os.utime(begin(run_dir, recording.metadata.robot), (1.0, 1.0))
    if down_after_s is not None:
        note_command(run_dir, "mrbt down", "ended by anna", max(ends.values()) + down_after_s)
    found = summary_of_finished(run_dir)
    assert found is not None
    assert {robot: row["state"] for robot, row in found["robots"].items()} == dict.fromkeys(
        ends, state
    )
    died = {each["robot"]: each["at_s"] for each in found["faults"] if each["kind"] == "major"}
    assert sorted(died) == (sorted(ends) if state == "dead" else [])
    assert all(at_s == pytest.approx(2, abs=0.6) for at_s in died.values()), died
    assert found["result"] == ("blocked" if down_after_s is None else "ended")


def test_when_what_was_not_recorded_has_ended_is_not_known(run_dir: RunDir) -> None:
    begin(run_dir, "R1")
    found = summary_of_finished(run_dir)
    assert found is not None
    assert found["duration_s"] is None


def sign(run_dir: RunDir) -> Path:
    """Give the run keys; the operator's."""
    KeyFolder.create(run_dir.keys_path, {"operator": Role.OPERATOR, "R1": Role.ROBOT})
    return run_dir.keys_path / "operator.key"


def afterwards(run_dir: RunDir) -> int | None:
    text = (run_dir.path / SIGNATURE_FILE).read_text()
    return parse_signature(text, RUN).covered.afterwards_unix_s


def test_who_has_not_seen_the_end_signs_that_it_was_afterwards(run_dir: RunDir) -> None:
    begin(run_dir, "R1")
    sign(run_dir)
    begun_s = int(time.time())
    assert summary_of_finished(run_dir) is not None
    at_s = afterwards(run_dir)
    assert at_s is not None
    assert begun_s <= at_s <= time.time()
    assert summary_of_finished(run_dir, is_witness=True) is not None
    assert afterwards(run_dir) is None, "a witness was slower"
    before = (run_dir.path / SIGNATURE_FILE).read_bytes()
    summary_of_finished(run_dir)
    summary_of_finished(run_dir, is_witness=True)
    assert (run_dir.path / SIGNATURE_FILE).read_bytes() == before


def test_a_witness_signs_no_summary_of_anybody_else(run_dir: RunDir) -> None:
    begin(run_dir, "R1")
    sign(run_dir)
    run_dir.write_summary({"result": "success"})
    found = summary_of_finished(run_dir, is_witness=True)
    assert found is not None
    assert found["result"] == "blocked"


def test_a_key_that_is_refused_leaves_no_summary(run_dir: RunDir) -> None:
    begin(run_dir, "R1")
    key = sign(run_dir)
    key.chmod(0o644)
    with pytest.raises(InputError, match="chmod 600"):
        summary_of_finished(run_dir)
    assert run_dir.summary() is None
    key.chmod(0o600)
    assert summary_of_finished(run_dir) is not None
    assert afterwards(run_dir) is not None


def test_a_summary_is_written_where_the_file_system_has_no_links(
    run_dir: RunDir, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    assert run_dir.write_first_summary({"result": "blocked"})
    assert not run_dir.write_first_summary({"result": "success"})
    assert run_dir.summary() == {"result": "blocked"}


def test_of_two_that_write_a_summary_both_show_that_of_the_first(run_dir: RunDir) -> None:
    assert run_dir.write_first_summary({"result": "blocked", "duration_s": 1.0})
    assert not run_dir.write_first_summary({"result": "blocked", "duration_s": 1.1})
    assert run_dir.summary() == {"result": "blocked", "duration_s": 1.0}
    begin(run_dir, "R1")
    assert summary_of_finished(run_dir) == run_dir.summary()
    assert not list(run_dir.path.glob(".summary*")), "nothing else is left"
