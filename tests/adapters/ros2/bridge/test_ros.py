"""The bridge with real rclpy on both sides: actions, services, topics, and servers that die.

`make test-ros2` gets what this needs.
"""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh.adapters.ros2.binding_file import PYTHON_VARIABLE, load_bindings
from mrbt_mesh.adapters.ros2.bridge_process import bridge_command, check_bindings
from mrbt_mesh.adapters.ros2.program import ConnectedRobot
from mrbt_mesh.errors import FileError, TaskFailedError
from mrbt_mesh.runtime.context import TaskContext
from tests.support import fake_port
from tests.support.paths import ROOT
from tests.support.ros2.virtual_robots import free_domain, lacking

pytestmark = [
    pytest.mark.processes,
    pytest.mark.slow,
    pytest.mark.skipif(bool(lacking()), reason=lacking()),
]
WAIT_S = 60
# What is missing at the start is a fault, whatever the load.
PATIENT = "start_up_s: 0\ndetection_s: 10\n"
BINDINGS = f"""\
bridge: {{domain: {free_domain()}}}
local_tasks:
  work:
    parameters: [order]
    action: /$robot/work
    type: test_msgs/action/Fibonacci
    goal: {{order: $order}}
    progress: len(m.sequence) / 10
    sets: {{counted: "len(m.sequence) > 3"}}
  ask:
    parameters: [answer]
    service: /$robot/ask
    type: std_srvs/srv/SetBool
    request: {{data: $answer}}
  managed:
    service: /$robot/ask
    type: std_srvs/srv/SetBool
    request: {{data: true}}
    lifecycle: /$robot/manager
  command:
    parameters: [word]
    topic: /$robot/command
    type: std_msgs/msg/String
    message: {{data: $word}}
    until: {{topic: /$robot/done, type: std_msgs/msg/String, expression: "'done' in m.data"}}
conditions:
  open: {{topic: /$robot/door, type: std_msgs/msg/Bool, expression: m.data, latched: true}}
entries:
  aside: {{topic: /$robot/odom, type: nav_msgs/msg/Odometry, expression: m.pose.pose.position.y}}
position:
  topic: /$robot/odom
  type: nav_msgs/msg/Odometry
  x: m.pose.pose.position.x
  y: m.pose.pose.position.y
  heading: yaw(m.pose.pose.orientation)
"""


CAPABILITIES = ("work", "ask", "command", "managed")
ALL = (*CAPABILITIES, "wave", "list")


class Told:
    """A port that keeps what is said, and wakes whoever waits for it."""

    def __init__(self) -> None:
        self.said: list[tuple[Any, ...]] = []
        self.news = anyio.Event()

    def __getattr__(self, name: str) -> Any:
        def say(*arguments: Any) -> None:
            self.said.append((name, *arguments))
            self.news.set()
            self.news = anyio.Event()

        return say

    async def until_lost(self, name: str, why: str) -> None:
        """Until a capability is lost for a reason that begins so."""
        with anyio.fail_after(WAIT_S):
            while not any(
                each[:2] == ("lose_capability", name) and each[2].startswith(why)
                for each in self.said
            ):
                await self.news.wait()

    async def until(self, *said: Any, after: int = 0) -> None:
        """Until this has been said, with whatever else, such as a reason."""
        with anyio.fail_after(WAIT_S):
            while all(each[: len(said)] != said for each in self.said[after:]):
                await self.news.wait()


def context(port: Told) -> TaskContext:
    return fake_port.context(port, "", robot="A1", robot_type="Rover", capabilities=ALL)


class Servers:
    """The process of tests/support/ros2/servers.py."""

    def __init__(self) -> None:
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        script = str(ROOT / "tests/support/ros2/servers.py")
        self.process = subprocess.Popen(
            [os.environ[PYTHON_VARIABLE], script, "/A1"],
            env=os.environ | {"ROS_DOMAIN_ID": str(free_domain())},
        )

    def kill(self) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.wait()


@pytest.fixture
def servers() -> Iterator[Servers]:
    """Servers that run, and are ended whatever happens."""
    found = Servers()
    found.start()
    yield found
    found.kill()


@asynccontextmanager
async def bridged(folder: Path, text: str) -> AsyncIterator[tuple[ConnectedRobot, Told]]:
    """A robot with a bridge that has just been started."""
    path = folder / "ros2.yaml"
    path.write_text(text)
    file = load_bindings(path)
    robot, told = ConnectedRobot(file, "A1", bridge_command(file)), Told()
    async with anyio.create_task_group() as group:
        group.start_soon(robot.run, context(told))
        yield robot, told
        group.cancel_scope.cancel()


@asynccontextmanager
async def connected(
    folder: Path, text: str = BINDINGS
) -> AsyncIterator[tuple[ConnectedRobot, Told]]:
    """A robot whose bridge has found all servers."""
    async with bridged(folder, text) as (robot, told):
        for name in CAPABILITIES:
            if name != "managed":
                await told.until("restore_capability", name)
        yield robot, told


async def perform(robot: ConnectedRobot, name: str, *arguments: str) -> list[tuple[Any, ...]]:
    """Have a task done; what it said."""
    told = Told()
    with anyio.fail_after(WAIT_S):
        await robot.perform(context(told), name, arguments)
    return told.said


async def test_actions_services_topics_and_conditions(servers: Servers, tmp_path: Path) -> None:
    async with connected(tmp_path) as (robot, told):
        await told.until("set_condition", "open", True, False)
        await told.until("report_position", 3.5, 0.0, 0.0)
        assert robot.pose == (3.5, 0.0)
        with anyio.fail_after(WAIT_S):
            while robot.entries != {"aside": 0.0}:
                await told.news.wait()
        said = await perform(robot, "work", "4")
        assert said[-1] == ("set_condition", "counted", True, False)
        assert said[0][0] == "report_progress"
        with pytest.raises(TaskFailedError, match="the server aborted the goal"):
            await perform(robot, "work", "13")
        with pytest.raises(TaskFailedError, match="the server rejected the goal"):
            await perform(robot, "work", "0")
        with pytest.raises(TaskFailedError, match="order: a number is expected, not 'many'"):
            await perform(robot, "work", "many")
        await perform(robot, "ask", "true")
        with pytest.raises(TaskFailedError, match="so it is"):
            await perform(robot, "ask", "false")
        await perform(robot, "command", "jump")


@pytest.mark.parametrize("order", ["500", "777"])
async def test_a_cancelled_goal_has_stopped_when_the_task_ends(
    servers: Servers, tmp_path: Path, order: str
) -> None:
    async with connected(tmp_path) as (robot, _):
        told = Told()
        async with anyio.create_task_group() as group:
            group.start_soon(robot.perform, context(told), "work", (order,))
            with anyio.fail_after(WAIT_S):
                await told.news.wait()
            group.cancel_scope.cancel()
        assert not robot._at_servers
        # So the next one begins at once.
        await perform(robot, "work", "2")


async def test_a_node_has_to_be_active(servers: Servers, tmp_path: Path) -> None:
    async with connected(tmp_path) as (robot, told):
        assert ("restore_capability", "managed") not in told.said
        await perform(robot, "command", "activate")
        await told.until("restore_capability", "managed")
        await perform(robot, "managed")
        await perform(robot, "command", "deactivate")
        await told.until("lose_capability", "managed")


async def test_servers_that_are_killed_are_lost_and_found_again(
    servers: Servers, tmp_path: Path
) -> None:
    """All three are lost when they do not answer, whatever DDS tells of them, and when."""
    async with connected(tmp_path) as (_, told):
        for _ in range(2):
            count = len(told.said)
            servers.kill()
            for name in ("work", "ask", "command"):
                await told.until("lose_capability", name, after=count)
            servers.start()
            for name in ("work", "ask", "command"):
                await told.until("restore_capability", name, after=count)


async def test_a_server_that_stands_still_is_lost_and_its_goal_cancelled_afterwards(
    servers: Servers, tmp_path: Path
) -> None:
    async with connected(tmp_path) as (robot, told):
        work = Told()
        assert servers.process is not None
        async with anyio.create_task_group() as group:
            group.start_soon(robot.perform, context(work), "work", ("500",))
            with anyio.fail_after(WAIT_S):
                await work.news.wait()
            servers.process.send_signal(signal.SIGSTOP)
            await told.until("lose_capability", "work")
            # As the plan does when the capability is lost.
            group.cancel_scope.cancel()
        count = len(told.said)
        assert robot._at_servers
        servers.process.send_signal(signal.SIGCONT)
        await told.until("restore_capability", "work", after=count)
        # Nothing else begins before that goal has stopped.
        await perform(robot, "work", "2")
        assert not robot._at_servers


async def test_a_simulation_that_is_paused_does_not_stop_the_bridge(
    servers: Servers, tmp_path: Path
) -> None:
    """Its clock, remappings and parameters are those that launch files set."""
    parameters = tmp_path / "with blanks" / "bridge.yaml"
    parameters.parent.mkdir()
    override = "qos_overrides./A1/command.publisher.depth: 3"
    parameters.write_text(f"/**:\n  ros__parameters:\n    {override}\n")
    settings = ", use_sim_time: true, namespace: /$robot, log_level: warn, "
    settings += f"remap: {{/$robot/labour: /$robot/work}}, parameters: '{parameters}'"
    text = BINDINGS.replace(f"domain: {free_domain()}", f"domain: {free_domain()}{settings}")
    text = text.replace("action: /$robot/work", "action: labour").replace(
        "topic: /$robot/command", "topic: command"
    )
    async with connected(tmp_path, text) as (robot, _):
        await perform(robot, "command", "jump")
    assert "/$robot/labour" in text


async def test_a_server_of_another_type_is_called_that(servers: Servers, tmp_path: Path) -> None:
    text = BINDINGS.replace("test_msgs/action/Fibonacci", "test_msgs/action/NestedMessage")
    for line in ("    goal:", "    progress: len", "    sets: {counted"):
        start = text.index(line)
        text = text[:start] + text[text.index("\n", start) + 1 :]
    other = "is there with the type test_msgs/action/Fibonacci, not test_msgs/action/NestedMessage"
    async with bridged(tmp_path, "start_up_s: 0\n" + text) as (_, told):
        await told.until("lose_capability", "work", f"action server /A1/work {other}")


async def test_what_does_not_fit_is_named(servers: Servers, tmp_path: Path) -> None:
    """Its type, its quality of service, a lifecycle node that is not there."""
    text = BINDINGS.replace("/$robot/manager", "/$robot/nobody")
    start = text.index("  command:")
    text = text[:start] + text[start:].replace("std_msgs/msg/String", "std_msgs/msg/Bool", 1)
    override = "qos_overrides./A1/wave.publisher.reliability: best_effort"
    parameters = tmp_path / "bridge.yaml"
    parameters.write_text(f"/**:\n  ros__parameters:\n    {override}\n")
    domain = f"domain: {free_domain()}"
    text = text.replace(domain, f"{domain}, parameters: {parameters}")
    wave = "  wave: {topic: /$robot/wave, type: std_msgs/msg/Bool, message: {data: true}}\n"
    list_them = "  list: {service: /$robot/servers/list_parameters, type: std_srvs/srv/Empty}\n"
    text = PATIENT + text.replace("conditions:\n", f"{wave}{list_them}conditions:\n")
    async with bridged(tmp_path, text) as (_, told):
        for name, why in (
            ("managed", "service /A1/ask waits for /A1/nobody, which has not been found"),
            ("list", "service /A1/servers/list_parameters is there with the type rcl_interfaces"),
            ("command", "topic /A1/command is there with the type std_msgs/msg/String, not std_"),
            ("wave", "topic /A1/wave has another quality of service: ERROR: Best effort publis"),
        ):
            await told.until_lost(name, why)


async def test_two_servers_under_one_name_are_no_use(servers: Servers, tmp_path: Path) -> None:
    second = Servers()
    second.start()
    try:
        why = "is 2 servers that would all take a goal: give them namespaces"
        async with bridged(tmp_path, PATIENT + BINDINGS) as (_, told):
            await told.until("lose_capability", "work", f"action server /A1/work {why}")
            why = "is 2 servers that would all be called: give them namespaces"
            await told.until("lose_capability", "ask", f"service /A1/ask {why}")
    finally:
        second.kill()


def test_mistakes_that_only_ros_knows(tmp_path: Path) -> None:
    path = tmp_path / "ros2.yaml"
    for old, new, said in (
        (
            "{order: $",
            "{ordr: $",
            "work/goal/ordr: there is no field 'ordr'; did you",
        ),
        ("/SetBool", "/SetBol", "ask/type: std_srvs has no srv SetBol; did you mean 'SetBool'?"),
        ("position.x", "position.xx", "position/x: m.pose.pose.position.xx: there is no field"),
        ("m.data, l", "m.date, l", "open/expression: m.date: there is no field 'date'; did you"),
        ("len(m.sequence) / 10", "m.sequenc[0]", "work/progress: m.sequenc[0]: there is no field"),
    ):
        assert BINDINGS.count(old) >= 1, old
        # A server that is named twice has one type.
        text = BINDINGS.replace(old, new)
        path.write_text(text)
        with pytest.raises(FileError) as error:
            check_bindings(load_bindings(path))
        line = text[: text.index(new)].count("\n") + 1
        assert f"ros2.yaml:{line}: " in str(error.value)
        assert said in str(error.value)
    path.write_text(BINDINGS)
    check_bindings(load_bindings(path))
