"""A robot of ROS 2 as its runtime sees it, with a pipe whose other end is the test.

The bridge has its own tests; tests/processes/test_ros2.py has it all together.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh.adapters.program_kinds import ROS2
from mrbt_mesh.adapters.ros2 import bridge_process
from mrbt_mesh.adapters.ros2 import program as ros2_program
from mrbt_mesh.adapters.ros2.binding_file import load_bindings
from mrbt_mesh.adapters.ros2.program import ConnectedRobot, bound_program, robot_program
from mrbt_mesh.btcpp import BehaviorTree, NodeStatus
from mrbt_mesh.errors import InputError, TaskFailedError
from mrbt_mesh.runtime.context import RobotContext, TaskContext
from mrbt_mesh.runtime.program import functions_of
from mrbt_mesh.runtime.user_code import UserCall, running_call
from tests.support import fake_port
from tests.support.fake_port import Told
from tests.support.paths import ROOT

BINDINGS = """\
values: {place: {gate: {x: 1}, yard: {x: 2}}}
local_tasks:
  go:
    parameters: [place]
    action: /$robot/go
    type: test_robots/action/Drive
    goal: {x: $place.x}
    progress: 1 - m.left / 10
    success: m.code == 0
    reason: m.error
    sets: {at($place): true, tired: m.way > 100}
    within_s: 60
  plain: {action: /$robot/plain, type: test_robots/action/Drive}
  look: {service: /$robot/look, type: test_robots/srv/Look}
  wave:
    topic: /$robot/wave
    type: test_robots/msg/Point
    message: {x: 1}
    until: {topic: /$robot/arm, type: test_robots/msg/Scan, expression: m.is_on}
    on_cancel: {x: 0}
conditions:
  low($robot): {topic: /$robot/power, type: test_robots/msg/Scan, expression: m.level < 20}
entries:
  charge: {topic: /$robot/power, type: test_robots/msg/Scan, expression: m.level / 100}
position: {topic: /$robot/odom, type: test_robots/msg/Pose, x: m.x, y: m.y, heading: yaw(m.q)}
"""
QUATERNION = {"q.x": 0.0, "q.y": 0.0, "q.z": 0.0, "q.w": 1.0}


OWN = ("go", "look", "plain", "wave")


def context(port: Any) -> TaskContext:
    return fake_port.context(port, "", robot="A1", robot_type="Rover", capabilities=OWN)


class Pipe:
    """The robot's end of a pipe that leads to the test."""

    def __init__(self) -> None:
        self.said: list[dict[str, Any]] = []

    def say(self, message: dict[str, Any]) -> None:
        self.said.append(message)


class Robot:
    """A robot whose bridge is the test."""

    def __init__(self, folder: Path) -> None:
        file = folder / "ros2.yaml"
        file.write_text(BINDINGS)
        self.told = Told()
        self.file = load_bindings(file)
        self.member = ConnectedRobot(self.file, "A1", ["no-bridge"])
        self.member._background = context(self.told)
        self.member._servers.begin(self.member._background)
        self.told.said.clear()
        self.pipe = Pipe()

    def ready(self) -> None:
        self.hear("ready")

    def hear(self, op: str, **message: Any) -> None:
        pipe: Any = self.pipe
        self.member._take(pipe, {"op": op, **message})

    def up(self, name: str) -> None:
        self.hear("server", task=name, is_up=True, why="")

    def end(self, how: str, text: str = "", **fields: Any) -> None:
        run = [each for each in self.pipe.said if each["op"] == "start"][-1]["run"]
        self.hear("ended", run=run, how=how, text=text, fields=fields)

    @asynccontextmanager
    async def performing(self, name: str, *arguments: str) -> AsyncIterator[Any]:
        """A task under way; afterwards its outcome is in `outcome`."""
        work = _Work()
        async with anyio.create_task_group() as group:

            async def perform() -> None:
                try:
                    await self.member.perform(context(work.told), name, arguments)
                    work.outcome = "success"
                except TaskFailedError as error:
                    work.outcome = str(error)

            group.start_soon(perform)
            await anyio.wait_all_tasks_blocked()
            work.cancel = group.cancel_scope.cancel
            yield work


class _Work:
    outcome: str | None = None
    cancel: Any = None

    def __init__(self) -> None:
        self.told = Told()


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    """A robot whose bridge is ready."""
    made = Robot(tmp_path)
    made.ready()
    made.told.said.clear()
    return made


async def test_a_goal_with_progress_and_conditions(robot: Robot) -> None:
    async with robot.performing("go", "yard") as work:
        [start] = robot.pipe.said
        assert (start["op"], start["task"], start["body"]) == ("start", "go", {"x": 2})
        assert len(start["goal_id"]) == 16
        robot.hear("feedback", run=start["run"], fields={"left": 4})
        robot.end("succeeded", code=0, error="", way=250)
    assert work.outcome == "success"
    assert work.told.said == [
        ("report_progress", 0.6),
        ("set_condition", "at(yard)", True, False),
        ("set_condition", "tired", True, False),
    ]


@pytest.mark.parametrize(
    ("name", "how", "text", "fields", "outcome"),
    [
        ("go", "succeeded", "", {"code": 3, "error": "no path", "way": 0}, "no path"),
        ("go", "succeeded", "", {"code": 3, "error": "", "way": 0}, "the result says otherwise: m"),
        ("go", "aborted", "", {"error": "lost"}, "the server aborted the goal: lost"),
        ("plain", "aborted", "error code 9", {}, "the server aborted the goal: error code 9"),
        ("plain", "aborted", "", {}, "the server aborted the goal"),
        ("plain", "rejected", "", {}, "the server rejected the goal"),
        ("plain", "cancelled", "", {}, "the goal was cancelled by somebody else"),
        ("plain", "lost", "", {}, "nothing is known of it any more"),
        ("plain", "unfit", "x: a number is expected", {}, "x: a number is expected"),
        ("plain", "silenced", "", {}, "this robot's process stood still for 1 s: its goal was"),
        ("look", "succeeded", "door is shut", {"success": False}, "door is shut"),
        ("look", "succeeded", "", {"success": False}, "the service answered: success is false"),
        ("look", "succeeded", "all is well", {"success": True}, "success"),
        ("plain", "succeeded", "a warning", {}, "success"),
    ],
)
async def test_outcomes(
    robot: Robot, name: str, how: str, text: str, fields: Any, outcome: str
) -> None:
    async with robot.performing(name, *(["gate"] if name == "go" else [])) as work:
        robot.end(how, text, **fields)
    assert work.outcome.startswith(outcome)


async def test_arguments_that_lead_to_nothing_are_told(robot: Robot) -> None:
    async with robot.performing("go", "moon") as work:
        pass
    assert work.outcome == "values/place has no 'moon'; known: gate, yard"
    assert robot.pipe.said == []


async def test_a_cancelled_goal_is_cancelled_there_and_waited_for(robot: Robot) -> None:
    robot.up("plain")
    async with robot.performing("plain") as work:
        work.cancel()
        with anyio.CancelScope(shield=True):
            await anyio.wait_all_tasks_blocked()
            start, cancel = robot.pipe.said
            assert cancel == {"op": "cancel", "run": start["run"]}
            assert robot.member._runs
            robot.end("cancelled")
    assert not robot.member._runs
    assert work.outcome is None


async def test_a_task_that_waits_for_its_server_to_stop_says_so(robot: Robot) -> None:
    robot.up("plain")
    call = UserCall("local task plain", print, print)
    running_call.set(call)
    async with robot.performing("plain") as work:
        work.cancel()
        with anyio.CancelScope(shield=True):
            await anyio.wait_all_tasks_blocked()
        assert call.waits_for == "action server /A1/plain has not stopped its cancelled goal"
        robot.end("cancelled")


async def test_a_server_that_is_lost_is_not_waited_for(robot: Robot) -> None:
    robot.up("plain")
    async with robot.performing("plain") as work:
        robot.hear("server", task="plain", is_up=False, why="does not answer")
        # That alone is no failure: the plan takes the task away.
        await anyio.wait_all_tasks_blocked()
        assert robot.member._runs
        work.cancel()
    assert not robot.member._runs
    why = "action server /A1/plain does not answer"
    assert robot.told.said[-2:] == [
        ("restore_capability", "plain"),
        ("lose_capability", "plain", why, True),
    ]


async def test_what_is_not_done_in_its_time_has_failed_when_it_has_stopped(robot: Robot) -> None:
    """A failure has another robot begin, which must not be beside this one."""
    robot.up("go")
    object.__setattr__(robot.file.local_tasks["go"], "within_s", 0.0)
    async with robot.performing("go", "gate") as work:
        await anyio.wait_all_tasks_blocked()
        assert [each["op"] for each in robot.pipe.said] == ["start", "cancel"]
        robot.hear("server", task="go", is_up=False, why="does not stop its cancelled goal")
        await anyio.wait_all_tasks_blocked()
        assert work.outcome is None
        robot.end("cancelled")
    assert work.outcome == "not done within 0 s"


async def test_what_succeeds_all_the_same_is_a_success(robot: Robot) -> None:
    object.__setattr__(robot.file.local_tasks["go"], "within_s", 0.0)
    async with robot.performing("go", "gate") as work:
        await anyio.wait_all_tasks_blocked()
        robot.end("succeeded", code=0, error="", way=250)
    assert work.outcome == "success"


async def test_what_is_not_done_in_its_time_may_still_be_cancelled(robot: Robot) -> None:
    robot.up("go")
    object.__setattr__(robot.file.local_tasks["go"], "within_s", 0.0)
    async with robot.performing("go", "gate") as work:
        await anyio.wait_all_tasks_blocked()
        robot.hear("server", task="go", is_up=False, why="does not stop its cancelled goal")
        work.cancel()
    assert work.outcome is None
    assert [each["op"] for each in robot.pipe.said] == ["start", "cancel"]


async def test_a_topic_is_done_when_another_says_so(robot: Robot) -> None:
    async with robot.performing("wave") as work:
        robot.hear("heard", topic="until/wave", fields={"is_on": True})
        robot.end("succeeded")
        await anyio.wait_all_tasks_blocked()
        # That was said before the message had gone out.
        assert work.outcome is None
        robot.hear("heard", topic="until/wave", fields={"is_on": False})
        await anyio.wait_all_tasks_blocked()
        assert work.outcome is None
        robot.hear("heard", topic="until/wave", fields={"is_on": True})
    assert work.outcome == "success"
    assert len(robot.pipe.said) == 1


async def test_a_topic_has_a_message_for_cancellation(robot: Robot) -> None:
    async with robot.performing("wave") as work:
        robot.end("succeeded")
        await anyio.wait_all_tasks_blocked()
        work.cancel()
    assert [each["body"] for each in robot.pipe.said] == [{"x": 1}, {"x": 0}]


async def test_conditions_are_told_when_they_change(robot: Robot) -> None:
    for level in (50, 30, 10, 5, 60):
        robot.hear("heard", topic="condition/low($robot)", fields={"level": level})
    assert robot.told.said == [
        ("set_condition", "low(A1)", False, False),
        ("set_condition", "low(A1)", True, False),
        ("set_condition", "low(A1)", False, False),
    ]


TREE = """<root BTCPP_format="4"><BehaviorTree ID="Main"><DistanceController distance="1">
<ScriptCondition code="charge > 0.2"/></DistanceController></BehaviorTree></root>"""


def test_trees_read_what_topics_have_said_last(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros2_program, "ConnectedRobot", lambda *_: robot.member)
    leaves = functions_of(bound_program(robot.file, ["no-bridge"])).leaves
    task = context(robot.told)
    file, given = tmp_path / "tree.xml", {RobotContext: task, TaskContext: task}
    file.write_text(TREE)
    tree = BehaviorTree.from_file(file, leaves=leaves, given=given)
    heard: list[tuple[object, NodeStatus]] = [
        (50, NodeStatus.SUCCESS),
        ("?", NodeStatus.SUCCESS),
        (10, NodeStatus.FAILURE),
    ]
    for level, status in heard:
        robot.hear("heard", topic="entry/charge", fields={"level": level})
        assert tree.executor.tick(0) is status
    robot.hear("heard", topic="position", fields={"x": 1.0, "y": 2.0, **QUATERNION})
    assert leaves.sources["robot_pose"].bound(given)() == (1.0, 2.0)


async def test_positions(robot: Robot) -> None:
    robot.hear("heard", topic="position", fields={"x": 1.0, "y": 2.0, **QUATERNION})
    robot.hear("heard", topic="position", fields={"x": "far", "y": 2.0, **QUATERNION})
    assert robot.told.said == [("report_position", 1.0, 2.0, 0.0)]


async def test_a_task_waits_for_a_bridge_that_is_not_there_yet(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    async with robot.performing("plain") as work:
        assert robot.pipe.said == []
        robot.ready()
        assert [each["op"] for each in robot.pipe.said] == ["start"]
        robot.end("succeeded")
    assert work.outcome == "success"


async def test_the_goals_of_a_bridge_that_ended_are_cancelled_by_the_next(robot: Robot) -> None:
    robot.up("plain")
    async with robot.performing("plain") as work:
        [start] = robot.pipe.said
        robot.member._bridge_ended()
        ended = ("lose_capability", "plain", "the bridge to ROS has ended", True)
        assert ended in robot.told.said
        forget = {"op": "forget", "task": "plain", "run": 1, "goal_id": start["goal_id"]}
        for _ in range(2):
            # The next one may end as well.
            robot.pipe = Pipe()
            robot.ready()
            assert robot.pipe.said == [forget]
        await anyio.wait_all_tasks_blocked()
        assert work.outcome is None
        robot.hear("ended", run=1, how="cancelled", text="", fields={})
    assert work.outcome == "nothing is known of it any more: the bridge to ROS had ended"
    # What has ended is not cancelled again.
    robot.pipe = Pipe()
    robot.member._bridge_ended()
    robot.ready()
    assert robot.pipe.said == []


async def test_a_bridge_that_ends_is_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a process that stands in for it, and echoes what it is told."""
    monkeypatch.setattr(ros2_program, "RESTART_S", 0.0)
    robot = Robot(tmp_path)
    robot.member._command = [sys.executable, str(ROOT / "tests/support/ros2/standin_bridge.py")]
    heard: list[dict[str, Any]] = []
    again = anyio.Event()

    def take(pipe: Any, message: dict[str, Any]) -> None:
        told = message["message"]
        if told.get("op") == "beat":
            return
        heard.append(told)
        if len(heard) == 1:
            pipe.say({"op": "end"})
        elif len(heard) == 2:
            again.set()

    monkeypatch.setattr(robot.member, "_take", take)
    with anyio.fail_after(60):
        async with anyio.create_task_group() as group:
            group.start_soon(robot.member.run, context(robot.told))
            await again.wait()
            group.cancel_scope.cancel()
    assert [each["node"] for each in heard] == ["mrbt_A1", "mrbt_A1"]


async def test_the_last_words_of_a_bridge_are_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Robot(tmp_path)
    text = "import sys; sys.stdin.buffer.read(1); sys.exit('Could not load type support')"
    robot.member._command = [sys.executable, "-c", text]
    whys, is_told = [], anyio.Event()

    def all_lost(why: str) -> None:
        whys.append(why)
        is_told.set()

    monkeypatch.setattr(robot.member._servers, "all_lost", all_lost)
    with anyio.fail_after(60):
        async with anyio.create_task_group() as group:
            group.start_soon(robot.member.run, context(robot.told))
            await is_told.wait()
            group.cancel_scope.cancel()
    assert whys == ["the bridge to ROS has ended: Could not load type support"]


def test_reasons_name_a_server_with_its_namespace(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    servers = robot.member._servers
    assert servers.called("look") == "service /A1/look"
    object.__setattr__(robot.file.bridge, "namespace", "/$robot")
    object.__setattr__(robot.file.local_tasks["look"], "service", "look")
    assert servers.called("look") == "service /A1/look"


async def test_a_bridge_that_stands_still_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros2_program, "RESTART_S", 0.0)
    monkeypatch.setattr(bridge_process, "STOP_S", 0.0)
    robot = Robot(tmp_path)
    object.__setattr__(robot.file, "detection_s", 0.5)
    robot.member._command = [sys.executable, str(ROOT / "tests/support/ros2/standin_bridge.py")]
    take, binds, heard = robot.member._take, anyio.Event(), []

    def taken(pipe: Any, message: dict[str, Any]) -> None:
        if message["op"] == "ready":
            take(pipe, message)
            robot.up("plain")
            pipe.say({"op": "freeze"})
        elif message["op"] != "echo":
            take(pipe, message)
        elif "node" in message["message"] and not heard:
            heard.append(message)
            pipe.say({"say": {"op": "ready"}})
        elif "node" in message["message"]:
            binds.set()

    monkeypatch.setattr(robot.member, "_take", taken)
    with anyio.fail_after(60):
        async with anyio.create_task_group() as group:
            group.start_soon(robot.member.run, context(robot.told))
            await binds.wait()
            group.cancel_scope.cancel()
    told = [each for each in robot.told.said if each[1] == "plain"][-2:]
    ended = ("lose_capability", "plain", "the bridge to ROS has ended", True)
    assert told == [("restore_capability", "plain"), ended]


async def test_a_robot_begins_without_its_capabilities(tmp_path: Path) -> None:
    """They are not there yet; after the time for the start that is a fault."""
    robot = Robot(tmp_path)
    object.__setattr__(robot.file, "start_up_s", 0.0)
    program = bound_program(robot.file, ["no-such-program"])
    assert sorted(functions_of(program).local_tasks) == ["go", "look", "plain", "wave"]
    [connect] = functions_of(program).backgrounds
    async with anyio.create_task_group() as group:
        group.start_soon(connect.function, context(robot.told))
        await anyio.wait_all_tasks_blocked()
        group.cancel_scope.cancel()
    names = list(robot.file.local_tasks)
    said = [each[:2] for each in robot.told.said]
    assert said[: len(names)] == [("defer_capability", name) for name in names]
    assert said[-len(names) :] == [("lose_capability", name) for name in names]


def test_a_healthy_start_is_no_fault_and_says_what_is_awaited(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    robot.ready()
    robot.hear("server", task="go", is_up=False, why="waits for /A1/nav, which is inactive")
    robot.up("go")
    what = "action server /A1/go"
    assert [each for each in robot.told.said if each[1] == "go"] == [
        ("defer_capability", "go", f"{what} has not been found"),
        ("defer_capability", "go", f"{what} waits for /A1/nav, which is inactive"),
        ("restore_capability", "go"),
    ]
    # Once it was there, it is a fault.
    robot.hear("server", task="go", is_up=False, why="does not answer")
    assert robot.told.said[-1] == ("lose_capability", "go", f"{what} does not answer", True)


def test_a_program_of_a_file_is_checked_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MRBT_ROS2_PYTHON", sys.executable)
    with pytest.raises(InputError, match="cannot import rclpy"):
        functions_of(robot_program(ROS2.template / "ros2.yaml")).check_computer()


def test_the_package_does_not_import_ros() -> None:
    text = "import sys, mrbt_mesh.adapters.ros2; assert 'rclpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", text], check=True, env=dict(os.environ))
