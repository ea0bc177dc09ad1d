"""`mrbt new`: the files that it writes are a mission that can run."""

import sys
from pathlib import Path

import pytest

from mrbt_mesh.adapters.ros2 import program as ros2_program
from mrbt_mesh.adapters.ros2.binding_file import load_bindings
from mrbt_mesh.formats.mission_file import load_mission, mission_warnings
from mrbt_mesh.formats.shipped import example_mission, examples
from mrbt_mesh.formats.template import (
    FolderInUseError,
    example_files,
    template_files,
    write_files,
)
from mrbt_mesh.runtime.program_loader import check_program, load_program
from tests.support.paths import ROOT
from tests.support.workshop import needs_world


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
    written = write_files(tmp_path / "my_team", template_files("my_team", "ros2"))
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


def test_an_empty_folder_may_be_used(tmp_path: Path) -> None:
    assert len(write_files(tmp_path, template_files("my_team"))) == 3


def test_a_folder_in_use_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "robot.py").write_text("mine")
    with pytest.raises(FolderInUseError, match="is not empty; name a new folder"):
        write_files(tmp_path, template_files("my_team"))
    assert [path.name for path in tmp_path.iterdir()] == ["robot.py"]
    assert (tmp_path / "robot.py").read_text() == "mine"


def test_a_file_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "my_team"
    file.write_text("mine")
    with pytest.raises(FolderInUseError, match="is a file; name a new folder"):
        write_files(file, template_files("my_team"))
    assert file.read_text() == "mine"


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
