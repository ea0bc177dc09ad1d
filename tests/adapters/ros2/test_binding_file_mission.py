"""Binding files and the mission that they serve."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest

from mrbt_mesh.adapters.program_kinds import ROS2
from mrbt_mesh.adapters.ros2.binding_file import load_bindings
from mrbt_mesh.errors import FileError
from mrbt_mesh.formats.mission_file import load_mission

MISSION = ROS2.template / "mission.yaml"
REPORT = "    type: std_srvs/srv/Trigger\n"
SEEN = "conditions:\n  seen: {topic: /seen, type: std_msgs/msg/Bool, expression: m.data}\n"


def said(
    folder: Path,
    old: str,
    new: str,
    robots: Iterable[str] = ("A1",),
    mission: tuple[str, str] = ("", ""),
) -> str:
    """What is said of the template's file with a change, beside its mission with another one."""
    text = (ROS2.template / "ros2.yaml").read_text()
    assert text.count(old) == 1, old
    (folder / "ros2.yaml").write_text(text.replace(old, new))
    (folder / "mission.yaml").write_text(MISSION.read_text().replace(*mission))
    known = load_mission(folder / "mission.yaml")
    with pytest.raises(FileError) as error:
        load_bindings(folder / "ros2.yaml").check_mission(known, robots)
    found = str(error.value).replace(str(folder), "")
    assert found.startswith("/ros2.yaml:")
    return found


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("{seen($place)", "{seen", "go_to/sets/seen: mission my_team declares seen(place), not s"),
        ("{seen($place)", "{'seen(a,b)'", "declares seen(place), not seen(a,b)"),
        ("{seen($place)", "{'seen(('", "sets/seen((: a name with at most 8 arguments is"),
        ("position:\n", f"{SEEN}position:\n", "conditions/seen: mission my_team declares seen(pl"),
        ("    gate: {x", "    gat: {x", "go_to: go_to(gate): values/place has no 'gate'; did you"),
        ("  report:\n", "  reprt:\n", "local_tasks/reprt: mission my_team has no local task 'rep"),
    ],
)
def test_what_does_not_fit(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert expected in said(tmp_path, old, new)


def test_robots_whose_ids_make_no_names_of_ros(tmp_path: Path) -> None:
    found = said(tmp_path, REPORT, REPORT, ("A1", "A-2"))
    assert "local_tasks/report/service: '/A-2/report', for robot A-2, is not a name of ROS" in found
    assert "position/topic: '/A-2/odom'" in found


def test_a_call_of_an_exclusive_task_has_no_limit(tmp_path: Path) -> None:
    """It goes on at the server, and another robot would call a second one."""
    exclusive = ("  report:\n    needs:", "  report:\n    exclusive: true\n    needs:")
    found = said(tmp_path, REPORT, f"{REPORT}    within_s: 5\n", mission=exclusive)
    assert "local_tasks/report/within_s: an exclusive task needs it" in found


def test_arguments_of_jobs_are_known_later(tmp_path: Path) -> None:
    text = MISSION.read_text().replace("    - report\n", "    - report\n    - Jobs: all\n")
    jobs = "ends: never\njobs:\n  one: {parameters: {place: [gate, moon]}, tree: visit($place)}\n"
    (tmp_path / "mission.yaml").write_text(f"{text}\n{jobs}")
    mission = load_mission(tmp_path / "mission.yaml")
    assert any("{place}" in ground for ground in mission.local_task_types)
    load_bindings(ROS2.template / "ros2.yaml").check_mission(mission, ["A1"])
