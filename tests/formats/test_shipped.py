"""What users start from is found in a clone and in an installed package, and can run as it is."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from mrbt_mesh.adapters.program_kinds import ROS2
from mrbt_mesh.adapters.ros2 import program as ros2_program
from mrbt_mesh.adapters.ros2.binding_file import load_bindings
from mrbt_mesh.formats import shipped as module
from mrbt_mesh.formats.mission_file import load_mission, mission_warnings
from mrbt_mesh.formats.shipped import (
    FolderInUseError,
    UnknownExampleError,
    example_files,
    example_mission,
    examples,
    shipped,
    template_files,
    write_files,
)
from mrbt_mesh.runtime.program_loader import check_program, load_program
from tests.support.paths import ROOT
from tests.support.workshop import needs_world


def test_in_a_clone_it_is_beside_the_package() -> None:
    for folder in ("agents", "drills", "examples"):
        assert shipped(folder) == ROOT / folder


def test_in_an_installed_package_it_is_inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "__file__", str(tmp_path / "mrbt_mesh" / "formats" / "shipped.py"))
    (tmp_path / "examples").mkdir()
    assert shipped("examples") == tmp_path / "examples"
    inside = tmp_path / "mrbt_mesh" / "share" / "examples"
    (inside / "walk").mkdir(parents=True)
    (inside / "walk" / "mission.yaml").touch()
    (inside / "no_mission").mkdir()
    assert shipped("examples") == inside
    assert examples() == ["walk"]


def test_every_example_has_a_mission_that_finds_its_program() -> None:
    assert {"couriers", "lift", "vehicle_repair"} <= set(examples())
    for name in examples():
        mission = load_mission(example_mission(name))
        assert mission.program is not None
        assert Path(mission.program).is_file()


def test_an_unknown_example_is_refused_with_the_nearest() -> None:
    with pytest.raises(UnknownExampleError, match="no example 'courier'; did you mean 'couriers'"):
        example_mission("courier")
    with pytest.raises(UnknownExampleError, match="known: assembly, couriers, deliveries, depot"):
        example_mission("../drills")


def test_the_new_mission_and_its_robots_fit_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    folder = tmp_path / "teams" / "my_team"
    written = write_files(folder, template_files("my_team"))
    assert written == [folder / n for n in ("mission.yaml", "robot.py", "test_mission.py")]
    mission = load_mission(written[0])
    assert mission.name == "my_team"
    assert mission_warnings(mission) == []
    assert mission.program == str((folder / "robot.py").resolve())
    program = load_program(mission.program)
    for robot in mission.robots.values():
        assert check_program(program, mission, robot.capabilities) == []
    assert "simulated" not in written[1].read_text()


def test_robots_of_ros_2_and_their_mission_fit_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without ROS: the program that robot.py makes when the bridge has found nothing wrong."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(ros2_program, "check_bindings", lambda file: None)
    written = write_files(tmp_path / "my_team", template_files("my_team", ROS2.template))
    assert [path.name for path in written] == [
        *("mission.yaml", "robot.py", "ros2.yaml", "virtual_robots.py")
    ]
    mission = load_mission(written[0])
    assert mission_warnings(mission) == []
    assert mission.program is not None
    program = load_program(mission.program)
    assert program.record_work
    for robot in mission.robots.values():
        assert check_program(program, mission, robot.capabilities) == []
    bindings = load_bindings(written[2])
    assert bindings.values["place"].keys() == set(mission.parameters["patrol"])
    [sets] = [task.sets for task in bindings.local_tasks.values() if task.sets]
    assert {name.partition("(")[0] for name in sets} <= mission.conditions.keys()


@pytest.mark.parametrize("name", examples())
def test_the_copy_of_an_example_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Its program, and what that imports, lie beside the mission; nothing points elsewhere."""
    if name == "workshop":
        needs_world()
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "simulated", raising=False)
    written = write_files(tmp_path, example_files(name))
    assert not [path.name for path in written if "../" in path.read_text()]
    mission = load_mission(tmp_path / "mission.yaml")
    assert mission.digest == load_mission(example_mission(name)).digest
    assert mission.program is not None
    assert Path(mission.program).parent == tmp_path.resolve()
    program = load_program(mission.program)
    for robot in mission.robots.values():
        assert check_program(program, mission, robot.capabilities) == []
    if "simulated.py" in [path.name for path in written]:
        assert Path(str(sys.modules["simulated"].__file__)).parent == tmp_path.resolve()


def test_a_folder_is_used_only_if_it_is_empty(tmp_path: Path) -> None:
    assert len(write_files(tmp_path, {"robot.py": "mine"})) == 1
    for place, message in ((tmp_path, "is not empty"), (tmp_path / "robot.py", "is a file")):
        with pytest.raises(FolderInUseError, match=f"{message}; name a new folder"):
            write_files(place, template_files("my_team"))
    assert [path.name for path in tmp_path.iterdir()] == ["robot.py"]
    assert (tmp_path / "robot.py").read_text() == "mine"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[red, green, blue]", "[red, green, blue, white]"),
        ("P2: porter", "P2: porter, P3: porter"),
        ("carry($box): {min: 2, max: 3}", "carry($box): {min: 3, max: 3}"),
        ("P2: porter", "P2: {type: porter, capabilities: {carry: 2, look_at: null}}"),
    ],
)
def test_the_changes_that_the_guide_proposes_are_right(tmp_path: Path, old: str, new: str) -> None:
    guide = (ROOT / "docs" / "tutorial" / "your-robot.md").read_text()
    file = write_files(tmp_path, template_files("my_team"))[0]
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))
    assert mission_warnings(load_mission(file)) == []
    if "$" in new or "{" in new:
        assert new in guide
