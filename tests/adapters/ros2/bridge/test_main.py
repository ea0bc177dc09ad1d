"""The bridge's process, under a Python without ROS: what it says, and that it ends."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgpack
import pytest

from mrbt_mesh.adapters.ros2.bridge.main import Pipe
from mrbt_mesh.adapters.ros2.bridge_process import FOLDER

BIND: dict[str, Any] = {"check": True, "detection_s": 1.0, "node": "n", "tasks": [], "topics": []}


def run(bind: Any, *options: str, path: Path | None = None) -> tuple[list[Any], int]:
    """What a bridge says, and its status."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    environment |= {} if path is None else {"PYTHONPATH": str(path)}
    words = [sys.executable, *options, str(FOLDER), str(Path(msgpack.__file__).parent)]
    given = b"" if bind is None else msgpack.packb(bind)
    done = subprocess.run(words, input=given, env=environment, capture_output=True, check=False)
    unpacker = msgpack.Unpacker()
    unpacker.feed(done.stdout)
    return list(unpacker), done.returncode


def rclpy_of_nothing(folder: Path) -> Path:
    """A path on which rclpy can be imported, and prints."""
    (folder / "rclpy").mkdir()
    (folder / "rclpy/__init__.py").write_text("print('hello')\n")
    return folder


def test_a_python_without_ros_is_told() -> None:
    [said], status = run(BIND)
    assert status == 2
    assert said["op"] == "failed"
    assert f"{sys.executable} (Python {sys.version_info[0]}." in said["text"]
    assert "cannot import rclpy" in said["text"]


def test_a_python_without_msgpack_uses_the_robots() -> None:
    [said], _ = run(BIND, "-S")
    assert said["op"] == "failed"


def test_nothing_of_the_project_is_imported() -> None:
    """Also where it is installed: what the bridge needs is in its folder."""
    for path in FOLDER.glob("*.py"):
        lines = path.read_text().splitlines()
        imports = [line for line in lines if line.lstrip().startswith(("import ", "from "))]
        assert not [line for line in imports if "mrbt_mesh" in line], path


def test_it_ends_with_its_input() -> None:
    assert run(None) == ([], 0)


def test_what_libraries_print_is_not_among_the_messages(tmp_path: Path) -> None:
    said, status = run(BIND, path=rclpy_of_nothing(tmp_path))
    assert (said, status) == ([{"op": "checked", "problems": []}], 0)


def test_what_does_not_fit_is_told(tmp_path: Path) -> None:
    place = ["local_tasks", "go", "type"]
    task = {"kind": "action", "type": "no_msgs/action/Go", "type_place": place}
    said, _ = run(BIND | {"tasks": [task]}, path=rclpy_of_nothing(tmp_path))
    [problem] = said[0]["problems"]
    assert problem["place"] == place
    assert "no_msgs/action/Go: this Python has no no_msgs.action" in problem["text"]


@pytest.fixture
def ends() -> tuple[Pipe, int, int]:
    """A pipe, what to write to it and what to read from it."""
    theirs, ours = os.pipe()
    out, written = os.pipe()
    return Pipe(msgpack, theirs, written), ours, out


def test_messages_are_read_whatever_their_pieces(ends: tuple[Pipe, int, int]) -> None:
    pipe, ours, _ = ends
    content = msgpack.packb({"op": "a"}) + msgpack.packb({"op": "b"})
    os.write(ours, content[:9])
    assert pipe.read() == {"op": "a"}
    os.write(ours, content[9:])
    os.close(ours)
    assert pipe.read() == {"op": "b"}
    assert pipe.read() is None


def test_a_robot_that_does_not_read_does_not_hold_up_the_bridge(
    ends: tuple[Pipe, int, int],
) -> None:
    pipe, _, out = ends
    for number in range(3):
        pipe.tell({"n": number, "text": "x" * 100_000})
    unpacker = msgpack.Unpacker()
    found: list[int] = []
    while len(found) < 3:
        unpacker.feed(os.read(out, 65_536))
        found += [each["n"] for each in unpacker]
    assert found == [0, 1, 2]
    assert pipe.close(7) == 7
