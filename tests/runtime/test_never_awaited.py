"""A forgotten `await` fails what has forgotten it, whatever kind of function that is."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotContext, RobotProgram, TaskContext
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.sim import SimulationResult, simulate
from mrbt_mesh.testing import run
from tests.support.build import action, make_mission, task

HERE = r"\(test_never_awaited\.py:\d+\)"


async def drive(metres: float = 1.0) -> bool:
    await anyio.sleep(metres)
    return False


class Arm:
    async def lift(self) -> None:
        await anyio.sleep(1)


# -- ways to forget it ------------------------------------------------------------------------


async def calls(context: RobotContext, *_: str) -> None:
    drive()  # type: ignore[unused-coroutine]


async def calls_a_method_later(context: RobotContext, *_: str) -> None:
    await anyio.sleep(1)
    Arm().lift()  # type: ignore[unused-coroutine]


async def keeps_it(context: RobotContext, *_: str) -> None:
    motion = drive(2)
    await anyio.sleep(1)
    del motion


async def asks_whether(context: RobotContext, *_: str) -> None:
    if drive():  # type: ignore[truthy-bool]
        await anyio.sleep(1)


async def of_a_library(context: RobotContext, *_: str) -> None:
    asyncio.sleep(5)  # type: ignore[unused-coroutine]


async def in_a_task_of_its_own(context: RobotContext, *_: str) -> None:
    async def child() -> None:
        drive()  # type: ignore[unused-coroutine]

    async with anyio.create_task_group() as group:
        group.start_soon(child)
        await anyio.sleep(1)


async def in_a_partial(context: RobotContext, *_: str) -> None:
    partial(drive, 3)()  # type: ignore[unused-coroutine]


async def waits_for_nothing(context: RobotContext, *_: str) -> None:
    asyncio.wait_for(asyncio.Event().wait(), 1)  # type: ignore[unused-coroutine]


def plain(context: RobotContext, *_: str) -> None:
    drive()  # type: ignore[unused-coroutine]


async def gathers(context: RobotContext, *_: str) -> None:
    asyncio.gather(drive(), drive(2))
    await anyio.sleep(0.1)


ASYNC = [
    calls,
    calls_a_method_later,
    keeps_it,
    asks_whether,
    of_a_library,
    in_a_task_of_its_own,
    in_a_partial,
    waits_for_nothing,
    gathers,
]


async def rest(task: TaskContext) -> None:
    await anyio.sleep(20)


async def arrives(task: TaskContext, place: str) -> None:
    pass


def result_of(robot: RobotProgram, kind: str) -> SimulationResult:
    needed = ("bad", 1, 1, True) if kind == "bid" else ("bad", 1, 1)
    mission = make_mission(action("bad"), {"R1": {"bad": 1.0}}, [task("bad", needed)])
    if kind in ("travel", "travel time"):
        places = {"dock": (0, 0), "home": (0, 0)}
        mission = replace(
            mission, travel=Travel(places, {"bad": "dock"}, {"R1": "home"}, {"R1": 1})
        )
    return simulate(mission, robot, seed=1, timeout_us=100_000_000)


def told(found: SimulationResult) -> list[str]:
    said = [each["reason"] for each in found.summary["failures"]]
    return said + [each["problem"] for each in found.summary["problems"] if each["problem"]]


@pytest.mark.parametrize("way", ASYNC)
@pytest.mark.parametrize("kind", ["local task", "travel", "background", "bid", "travel time"])
def test_it_fails_with_the_line(kind: str, way: Callable[..., Any]) -> None:
    robot = RobotProgram()
    if kind != "local task":
        robot.local_task("bad")(rest)
    if kind == "travel time":
        robot.travel(arrives)
    registered = {
        "local task": robot.local_task("bad"),
        "travel": robot.travel,
        "background": robot.background(costs="none"),
        "bid": robot.bid("bad"),
        "travel time": robot.travel_time,
    }
    registered[kind](way)
    found = result_of(robot, kind)
    pattern = rf"(\w+|gather\(drive\(\)\))(\(\))? was never awaited {HERE}: put await before it"
    assert any(re.search(pattern, each) for each in told(found)), told(found)
    assert found.result == ("failure" if kind in ("local task", "travel") else "success")


def test_a_plain_function_may_forget_it_too() -> None:
    robot = RobotProgram()
    robot.local_task("bad")(rest)
    robot.bid("bad")(plain)
    assert any("drive() was never awaited" in each for each in told(result_of(robot, "bid")))


def test_what_is_awaited_in_any_way_is_no_failure() -> None:
    robot = RobotProgram()

    @robot.local_task("bad")
    async def work(task: TaskContext) -> None:
        await asyncio.gather(drive(), drive())
        await asyncio.create_task(drive())
        async with asyncio.TaskGroup() as group:
            group.create_task(drive())
        with anyio.move_on_after(0.5):
            await asyncio.gather(drive(), drive())
        done = await asyncio.gather(_fails(), return_exceptions=True)
        assert isinstance(done[0], ValueError)
        drive().close()

    found = result_of(robot, "local task")
    assert (found.result, told(found)) == ("success", [])


async def _fails() -> None:
    raise ValueError


def test_an_exception_goes_before_what_it_keeps_from_being_awaited() -> None:
    robot = RobotProgram()

    @robot.local_task("bad")
    async def work(task: TaskContext) -> None:
        await asyncio.gather(drive(), drive(1 / 0))

    assert told(result_of(robot, "local task"))[0].startswith("ZeroDivisionError")


def test_a_task_that_goes_on_after_the_local_task_is_named() -> None:
    robot, kept = RobotProgram(), list[Any]()

    @robot.local_task("bad")
    async def work(task: TaskContext) -> None:
        kept.append(asyncio.create_task(drive(3)))

    found = result_of(robot, "local task")
    assert found.result == "success"
    assert re.search(rf"a task started by: drive goes on {HERE}", told(found)[0])


TREE = """\
<root BTCPP_format="4" main_tree_to_execute="P">
  <BehaviorTree ID="P"><Sequence><Ok/><Drive/></Sequence></BehaviorTree>
  <TreeNodesModel><Condition ID="Ok"/><Action ID="Drive"/></TreeNodesModel>
</root>
"""
MISSION = """\
mission: tree
program: robot.py
local_tasks: {patrol: {tree: patrol.xml}}
robot_types: {r: {capabilities: {patrol: 1}}}
robots: {R1: r}
global_tasks: {patrol: {needs: {patrol: {min: 1}}}}
tree: patrol
"""
PROGRAM = """\
import anyio
from mrbt_mesh import RobotProgram, TaskContext
robot = RobotProgram()

async def move():
    await anyio.sleep(1)

@robot.condition("Ok")
def ok() -> bool:
    CONDITION
    return True

@robot.action("Drive")
ASYNC def drive(task: TaskContext) -> None:
    ACTION
"""


@pytest.mark.parametrize(
    ("condition", "action", "kind", "line"),
    [
        ("pass", "move()", "async", 15),
        ("pass", "move()", "", 15),
        ("move()", "pass", "async", 10),
    ],
)
def test_leaves_of_trees_too(
    condition: str, action: str, kind: str, line: int, tmp_path: Path
) -> None:
    text = PROGRAM.replace("CONDITION", condition).replace("ACTION", action)
    (tmp_path / "robot.py").write_text(text.replace("ASYNC ", f"{kind} ".lstrip()))
    (tmp_path / "patrol.xml").write_text(TREE)
    (tmp_path / "mission.yaml").write_text(MISSION)
    found = run(tmp_path / "mission.yaml")
    assert found.result == "failure"
    reason = f"move() was never awaited (robot.py:{line}): put await before it"
    assert found.whole.summary["failures"][0]["reason"] == reason
