"""`mrbt new`: a mission and a robot that run at once."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from mrbt_mesh.adapters.vda5050.layout_file import load_layout
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import check_program, load_program
from mrbt_mesh.testing import Kill, Submit, run
from tests.support.command import done, mrbt, refused


def test_new_writes_a_valid_mission_and_spares_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "my_team"
    assert "mrbt up" in done(mrbt("new", str(folder)))
    monkeypatch.chdir(folder)
    code, output, problems = mrbt("validate")
    assert (code, problems) == (0, "")
    assert output.splitlines() == [
        "valid my_team: 3 robots, 2 local tasks, 9 global tasks, 21 tree nodes"
    ]
    assert str(folder) in refused(mrbt("new", str(folder))).replace("\n", "")


def test_new_for_robots_of_ros_2(tmp_path: Path) -> None:
    folder = tmp_path / "my_team"
    output = done(mrbt("new", "--ros2", str(folder)))
    assert "virtual_robots.py A1 A2 A3" in output.replace("\n", "")
    assert mrbt("validate", str(folder / "mission.yaml"))[0] == 0
    problems = refused(mrbt("new", "--ros2", "--example", "couriers", str(tmp_path / "other")))
    assert "--example and --ros2: choose one of them" in problems


def test_a_fleet_of_agvs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    folder = tmp_path / "fleet"
    done(mrbt("new", str(folder), "--vda5050"))
    assert sorted(path.name for path in folder.iterdir()) == [
        "agvs.yaml",
        "mission.yaml",
        "robot.py",
    ]
    assert mrbt("validate", str(folder / "mission.yaml"))[0] == 0
    mission = load_mission(folder / "mission.yaml")
    layout = load_layout(folder / "agvs.yaml")
    assert set(layout.vehicles) == set(mission.robots)
    assert set(layout.local_tasks) == {"fetch"}
    assert mission.program is not None
    program = load_program(mission.program)
    assert program.record_work
    for robot in mission.robots.values():
        assert check_program(program, mission, robot.capabilities) == []


def test_a_team_that_is_handed_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    folder = tmp_path / "depot"
    done(mrbt("new", str(folder), "--jobs"))
    assert sorted(path.name for path in folder.iterdir()) == [
        "client.py",
        "mission.yaml",
        "robot.py",
        "test_mission.py",
    ]
    code, output, problems = mrbt("validate", str(folder / "mission.yaml"))
    assert (code, problems) == (0, "")
    assert "2 global tasks, 6 tree nodes, 1 job type, 5 places" in " ".join(output.split())
    jobs = [(2.0, Submit("fetch", [shelf, 1])) for shelf in "ABC"]
    faults = [(6.0, Kill("R1"))]
    found = run(folder / "mission.yaml", commands=jobs, faults=faults, until_jobs_end=True)
    assert {job.state for job in found.jobs} == {"succeeded"}


def test_one_thing_at_a_time(tmp_path: Path) -> None:
    problems = refused(mrbt("new", str(tmp_path / "x"), "--vda5050", "--example", "couriers"))
    assert "--example and --vda5050: choose one of them" in problems
