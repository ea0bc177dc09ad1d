"""`mrbt new`: a mission and a robot that run at once."""

from __future__ import annotations

from pathlib import Path

from tests.support.command import mrbt


def test_new_writes_a_valid_mission_and_spares_what_is_there(tmp_path: Path) -> None:
    folder = tmp_path / "my_team"
    code, output, _ = mrbt("new", str(folder))
    assert code == 0
    assert "mrbt up" in output
    assert mrbt("validate", str(folder / "mission.yaml"))[0] == 0
    code, _, problems = mrbt("new", str(folder))
    assert code == 2
    assert str(folder) in problems.replace("\n", "")


def test_new_for_robots_of_ros_2(tmp_path: Path) -> None:
    folder = tmp_path / "my_team"
    code, output, _ = mrbt("new", "--ros2", str(folder))
    assert code == 0
    assert "virtual_robots.py A1 A2 A3" in output.replace("\n", "")
    assert mrbt("validate", str(folder / "mission.yaml"))[0] == 0
    code, _, problems = mrbt("new", "--ros2", "--example", "couriers", str(tmp_path / "other"))
    assert code == 2
    assert "either --example or --ros2" in problems
