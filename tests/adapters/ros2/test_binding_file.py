"""Binding files: what they mean, and what is said of mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.adapters.program_kinds import ROS2
from mrbt_mesh.adapters.ros2.binding_file import (
    DEFAULT_PYTHON,
    PYTHON_VARIABLE,
    BindingFile,
    bind_message,
    load_bindings,
)
from mrbt_mesh.errors import FileError

FILE = ROS2.template / "ros2.yaml"
EVERYTHING = """\
bridge: {python: ros/bin/python, setup: ~/ws/install/setup.bash, domain: 7}
detection_s: 0.5
robots:
  A1: {namespace: tb3_0}
  A2: {namespace: tb3_1}
values:
  place:
    gate: {x: 1, y: 2}
    yard: {x: 3, y: 4}
local_tasks:
  go:
    parameters: [place]
    action: /$namespace/go
    type: test_robots/action/Drive
    goal: {pose: {position: {x: $place.x}}, names: [$place, "to $place"]}
    progress: 1 - m.left / 10
    success: m.error_code == 0
    reason: m.error_msg
    sets: {at($place): true, tired($robot): m.way > 100}
    within_s: 60
    lifecycle: /$namespace/navigator
  look:
    service: /$robot/look
    type: test_robots/srv/Look
    request: {name: door}
    success: m.success
  wave:
    topic: /$robot/wave
    type: test_robots/msg/Point
    message: {x: 1}
    until: {topic: /$robot/arm, type: test_robots/msg/Scan, expression: m.is_on}
    on_cancel: {x: 0}
conditions:
  near($robot):
    {topic: /$namespace/s, type: test_robots/msg/Scan, expression: min(m.ranges) < 1, latched: true}
entries:
  charge: {topic: /$namespace/power, type: test_robots/msg/Power, expression: m.level / 100}
position: {topic: /$namespace/odom, type: test_robots/msg/Pose, x: m.position.x, y: m.position.y}
"""


def load(folder: Path, text: str) -> BindingFile:
    file = folder / "ros2.yaml"
    file.write_text(text)
    return load_bindings(file)


def problems(folder: Path, old: str, new: str) -> str:
    """What is said of the file with a change."""
    assert EVERYTHING.count(old) >= 1, old
    with pytest.raises(FileError) as error:
        load(folder, EVERYTHING.replace(old, new, 1))
    return str(error.value).replace(str(folder), "")


@pytest.fixture(autouse=True)
def _no_other_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PYTHON_VARIABLE, raising=False)


def test_what_mrbt_new_writes() -> None:
    file = load_bindings(FILE)
    assert file.python == DEFAULT_PYTHON
    assert file.local_tasks.keys() == {"go_to", "report"}
    assert file.robot_values("A9") == {"robot": "A9"}
    assert file.position is not None
    assert file.position.expressions.keys() == {"x", "y", "heading"}


def test_what_the_bridge_is_told(tmp_path: Path) -> None:
    file = load(tmp_path, EVERYTHING)
    assert file.python == str(tmp_path / "ros/bin/python")
    assert file.setup == str(Path("~/ws/install/setup.bash").expanduser())
    bind = bind_message(file, "A2", "mrbt_A2")
    assert (bind["detection_s"], bind["check"], bind["node"]) == (0.5, False, "mrbt_A2")
    go, look, wave = bind["tasks"]
    assert (go["kind"], go["name"], go["lifecycle"]) == ("action", "/tb3_1/go", "/tb3_1/navigator")
    assert go["feedback"] == [["left", ["local_tasks", "go", "progress"]]]
    assert [path for path, *_ in go["result"]] == ["error_code", "error_msg", "way"]
    assert go["result"][2][1] == ["local_tasks", "go", "sets", "tired($robot)"]
    assert (look["kind"], look["name"], look["bodies"]) == ("srv", "/A2/look", [])
    assert (wave["kind"], wave["name"]) == ("msg", "/A2/wave")
    topics = {each["id"]: each for each in bind["topics"]}
    assert topics["until/wave"]["always"]
    near = topics["condition/near($robot)"]
    assert (near["name"], near["latched"], near["always"]) == ("/tb3_1/s", True, False)
    charge = topics["entry/charge"]
    assert (charge["name"], charge["always"]) == ("/tb3_1/power", False)
    assert charge["fields"] == [["level", ["entries", "charge", "expression"]]]
    assert [path for path, *_ in topics["position"]["fields"]] == ["position.x", "position.y"]


def test_what_is_checked_against_the_types(tmp_path: Path) -> None:
    bind = bind_message(load(tmp_path, EVERYTHING), None)
    assert bind["check"]
    go, _, wave = bind["tasks"]
    assert {tuple(each["place"]) for each in go["bodies"]} == {
        ("local_tasks", "go", "goal"),
        ("values", "place", "gate"),
        ("values", "place", "yard"),
    }
    assert [each["body"] for each in wave["bodies"]] == [{"x": 1}, {"x": 0}]


def test_what_the_bridge_finds_is_told_with_lines(tmp_path: Path) -> None:
    file = load(tmp_path, EVERYTHING)
    place = ["local_tasks", "go", "goal", "pose", "position", "x"]
    said = str(file.unfit([{"place": place, "text": "there is no field 'x'"}]))
    line = EVERYTHING[: EVERYTHING.index("goal:")].count("\n") + 1
    assert said.startswith(f"{tmp_path}/ros2.yaml:{line}: local_tasks/go/goal/pose/position/x: ")


def test_another_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PYTHON_VARIABLE, "/opt/ros/bin/python3")
    assert load(tmp_path, EVERYTHING).python == "/opt/ros/bin/python3"


def test_a_robot_that_the_file_lacks(tmp_path: Path) -> None:
    file = load(tmp_path, EVERYTHING)
    with pytest.raises(FileError, match="robots has no A3; "):
        file.robot_values("A3")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("    action: ", "    acton: ", "11: local_tasks/go: one of action, service and topic is"),
        ("    goal:", "    service: /x\n    goal:", "found action and service"),
        ("goal:", "request:", "/request: of no use for a task that is an action"),
        ("on_cancel: {x", "progress: m.x\n    on_cancel: {x", "of no use for a task that is a to"),
        ("/action/Drive", "/srv/Drive", "test_robots/action/Drive is expected here, found"),
        ("/action/Drive", ".Drive", "a type of ROS is expected, e.g. nav2_msgs/action/"),
        ("/$robot/look", "/a-b/look", "a name of ROS is expected, e.g. /$robot/navigate"),
        ("/$robot/look", "/$place/look", "unknown $place; known: namespace, robot"),
        ("$place.x}", "$plac.x}", "goal/pose/position/x: unknown $plac; did you mean 'place'?"),
        ("at($place)", "at($plac)", "sets/at($plac): unknown $plac; did you mean"),
        (
            "/$robot/arm, type: test_robots/msg/Scan",
            "/$robot/wave, type: test_robots/msg/Scan",
            "until/type: /$robot/wave has the type test_robots/msg/Point in local_tasks/wave",
        ),
        ('"to $place"', '"to $ place"', "'to $ place': after $ a name is expected; $$ is a dollar"),
        ('"to $place"', "$", "names[2]: '$': after $ a name is expected; $$ is a dollar sign"),
        ("{x: 3, y: 4}", "{x: 3, y: 4, frame: $plac}", "values/place/yard/frame: unknown $plac"),
        ("name: door}", "name: $robot.x}", "request/name: $robot.x: values has no table for robot"),
        ("{x: 3, y: 4}", "{y: 4}", "9: values/place/yard: $place.x: yard has no 'x'"),
        ("  place:\n", "  plac:\n", "no local task has a parameter 'plac'; did you mean"),
        ("m.left /", "left /", "fields of the message are m.NAME, e.g. m.left"),
        ("m.way > 100", "3", "true, false or an expression is expected, found the number 3"),
        ("A2: {namespace:", "A2: {name:", "all robots have the same keys: namespace, robot"),
        ("detection_s: 0.5", "detection_s: 0", "a number of at least 0.2 is expected"),
        ("min(m.ranges) < 1", "m.ranges <", "expression: 'm.ranges <' is not an expression"),
        ("domain: 7", "domain: 300", "bridge/domain: a number of at most 232 is expected"),
    ],
)
def test_mistakes(tmp_path: Path, old: str, new: str, said: str) -> None:
    found = problems(tmp_path, old, new)
    assert said in found
    assert found.startswith("/ros2.yaml:")


def test_what_is_no_mapping(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="bindings are expected"):
        load(tmp_path, "- go")


def test_a_topic_answers_nothing(tmp_path: Path) -> None:
    text = "    on_cancel: {x: 0}\n    sets: {waved: m.x > 1}\n"
    said = problems(tmp_path, "    on_cancel: {x: 0}\n", text)
    assert "a topic answers nothing: true or false is expected" in said
