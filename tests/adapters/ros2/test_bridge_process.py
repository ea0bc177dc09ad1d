"""The robot's end of the pipe, with a process that stands in for the bridge."""

from __future__ import annotations

import os
import sys
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh.adapters.program_kinds import ROS2
from mrbt_mesh.adapters.ros2.binding_file import PYTHON_VARIABLE, BindingFile, load_bindings
from mrbt_mesh.adapters.ros2.bridge_process import (
    WHEELS_VARIABLE,
    BridgePipe,
    bridge_command,
    bridge_environment,
    bridge_process,
    check_bindings,
)
from mrbt_mesh.errors import InputError
from tests.support.paths import ROOT

STANDIN = [sys.executable, str(ROOT / "tests/support/ros2/standin_bridge.py")]
PLACE = "ros2.yaml:4: bridge/python: "


@pytest.fixture
def file(monkeypatch: pytest.MonkeyPatch) -> BindingFile:
    """The file of `mrbt new --ros2`."""
    monkeypatch.delenv(PYTHON_VARIABLE, raising=False)
    return load_bindings(ROS2.template / "ros2.yaml")


def standin() -> AbstractAsyncContextManager[BridgePipe]:
    """A process that stands in for the bridge."""
    return bridge_process(STANDIN, dict(os.environ))


def saying(folder: Path, text: str) -> list[str]:
    """A command that says this in place of a bridge."""
    script = folder / "said.py"
    script.write_text(f"import msgpack, os, sys\nsys.stdin.buffer.read()\n{text}\n")
    return [sys.executable, str(script)]


async def test_messages_in_both_directions() -> None:
    heard: list[dict[str, Any]] = []
    with anyio.fail_after(30):
        async with standin() as pipe, anyio.create_task_group() as group:
            group.start_soon(pipe.send_on)
            pipe.say({"op": "one"})
            pipe.say({"op": "two", "goal_id": b"\x00\xff"})
            async for message in pipe.heard():
                heard.append(message["message"])
                if len(heard) == 2:
                    break
            group.cancel_scope.cancel()
    assert heard == [{"op": "one"}, {"op": "two", "goal_id": b"\x00\xff"}]


async def test_a_bridge_that_ends_is_noticed() -> None:
    with anyio.fail_after(30):
        async with standin() as pipe, anyio.create_task_group() as group:
            group.start_soon(pipe.send_on)
            pipe.say({"op": "end"})
            assert [message async for message in pipe.heard()] == []
            pipe.say({"op": "nobody hears this"})
            group.cancel_scope.cancel()


async def test_at_the_end_it_is_told_and_gone() -> None:
    lines: list[str] = []
    with anyio.fail_after(30):
        async with anyio.create_task_group() as group:

            async def listen(pipe: Any) -> None:
                lines.extend([line async for line in pipe.complaints()])

            async with standin() as pipe:
                group.start_soon(listen, pipe)
                await anyio.wait_all_tasks_blocked()
            process = pipe._process
    assert process.returncode == 0
    assert lines[0] == "[WARN] a line of ROS"


def test_the_command(file: BindingFile) -> None:
    python, folder, packer = bridge_command(file)
    assert python == "/usr/bin/python3"
    assert (Path(folder) / "__main__.py").is_file()
    assert (Path(packer) / "fallback.py").is_file()
    object.__setattr__(file.bridge, "setup", "/ws/setup.bash")
    object.__setattr__(file.bridge, "domain", 7)
    assert bridge_command(file)[:2] == ["bash", "-c"]
    assert bridge_command(file)[3:5] == ["/ws/setup.bash", "/usr/bin/python3"]
    assert bridge_environment(file)["ROS_DOMAIN_ID"] == "7"


def test_setup_files_are_sourced(file: BindingFile, tmp_path: Path) -> None:
    setup = tmp_path / "setup.sh"
    setup.write_text("export ROS_DISTRO=a_good_one\n")
    object.__setattr__(file.bridge, "setup", str(setup))
    object.__setattr__(file.bridge, "python", sys.executable)
    shell = bridge_command(file)[:4]
    text = "os.write(1, msgpack.packb({'op': 'failed', 'text': os.environ['ROS_DISTRO']}))"
    with pytest.raises(InputError, match="a_good_one"):
        check_bindings(file, [*shell, *saying(tmp_path, text)])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("os.write(1, msgpack.packb({'op': 'failed', 'text': 'no rclpy'}))", "no rclpy; name the"),
        ("raise SystemExit('broken')", "the bridge ended with status 1: broken"),
    ],
)
def test_a_bridge_that_does_not_come_up(
    file: BindingFile, tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(InputError) as error:
        check_bindings(file, saying(tmp_path, text))
    assert PLACE in str(error.value)
    assert said in str(error.value)


def test_what_it_finds_is_told_with_the_line(file: BindingFile, tmp_path: Path) -> None:
    problems = [{"place": ["local_tasks", "report", "type"], "text": "there is no Trigger"}]
    text = f"os.write(1, msgpack.packb({{'op': 'checked', 'problems': {problems}}}))"
    with pytest.raises(InputError, match=r"ros2.yaml:\d+: local_tasks/report/type: there is no T"):
        check_bindings(file, saying(tmp_path, text))
    check_bindings(file, saying(tmp_path, text.replace(str(problems), "[]")))


def test_a_python_that_is_not_there(file: BindingFile) -> None:
    object.__setattr__(file.bridge, "python", "/no/such/python")
    with pytest.raises(InputError, match="/no/such/python: No such file"):
        check_bindings(file)


def test_a_python_without_rclpy_is_told(file: BindingFile) -> None:
    object.__setattr__(file.bridge, "python", sys.executable)
    with pytest.raises(InputError, match="cannot import rclpy") as error:
        check_bindings(file)
    assert PLACE in str(error.value)


def test_what_launch_files_set_is_given_to_the_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(PYTHON_VARIABLE, raising=False)
    folder = tmp_path / "with blanks"
    folder.mkdir()
    path = folder / "ros2.yaml"
    path.write_text(
        "bridge: {namespace: /$robot, remap: {/tf: /$robot/tf}, use_sim_time: true,\n"
        "         parameters: node.yaml, log_level: debug, setup: setup.zsh}\n"
        "local_tasks: {go: {service: go, type: std_srvs/srv/Empty}}\n"
    )
    file = load_bindings(path)
    parameters = str(folder / "node.yaml")
    assert file.ros_arguments({"robot": "A1"}) == [
        *("-r", "__ns:=/A1", "-r", "/tf:=/A1/tf", "--params-file", parameters),
        *("-p", "use_sim_time:=true", "--log-level", "debug"),
    ]
    assert bridge_command(file)[0] == "zsh"
    with pytest.raises(
        InputError, match=r"yaml:2: bridge/parameters: there is no file .*node.yaml"
    ):
        check_bindings(file)
    path.write_text(path.read_text().replace("/$robot/tf", "/$robbot/tf"))
    with pytest.raises(InputError, match=r"unknown \$robbot"):
        load_bindings(path)


def test_what_other_packages_of_ros_have_set_is_not_passed_on(
    file: BindingFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = f"{sys.prefix}/lib"
    places = [own, "/opt/ros/kilted/lib", "/venv/site-packages/ros_kilted.libs"]
    monkeypatch.setenv("LD_LIBRARY_PATH", os.pathsep.join(places))
    monkeypatch.delenv(WHEELS_VARIABLE, raising=False)
    assert bridge_environment(file) == dict(os.environ)
    monkeypatch.setenv(WHEELS_VARIABLE, "1")
    found = bridge_environment(file)
    assert WHEELS_VARIABLE not in found
    assert found["LD_LIBRARY_PATH"] == "/opt/ros/kilted/lib"
    monkeypatch.setenv("LD_LIBRARY_PATH", own)
    assert "LD_LIBRARY_PATH" not in bridge_environment(file)
