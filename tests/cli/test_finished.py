"""Which summary is that of the run: of one that was resumed, and has not ended, there is none."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mrbt_mesh.cli.finished import summary_of_finished
from mrbt_mesh.cli.options import chosen_robots
from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.launcher_lock import launched_from_here
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import new_run
from tests.support.paths import mission_file


def test_a_run_that_nobody_watched_has_a_summary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = mission_file("explore")
    mission = load_mission(path)
    robots = chosen_robots("--robots", None, mission)
    info = new_run(mission, path, robots, RobotOptions(beat_s=1.0, detection_s=5.0))
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    run_dir = RunDir.create(tmp_path / "run", info, compile_mission(mission))
    assert summary_of_finished(run_dir) is None, "no robot was ever started"
    (run_dir.path / "R1.process").write_text('{"pid": 1, "started_unix_s": 0}')
    with launched_from_here(run_dir):
        assert summary_of_finished(run_dir) is None, "its launcher will write it"
    found = summary_of_finished(run_dir)
    assert found is not None
    assert (found["result"], found["ended_because"]) == ("blocked", "no robot is left")
    assert run_dir.summary() == found
    os.utime(run_dir.path / "summary.json", (info.started_unix_s - 1,) * 2)
    assert run_dir.summary() is None, "that of the run that this one resumes"
