"""Timeouts of a program's own, thousands of them: none is taken for a cancellation of its work."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotContext, RobotProgram, TaskContext
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.driven import MAX_SWALLOWED
from mrbt_mesh.sim import Lose, SimulationResult, simulate
from mrbt_mesh.testing import run
from tests.support.build import action, make_mission, task

TIMES = MAX_SWALLOWED + 500
WAIT_S = 0.01


async def moves_on_after() -> None:
    with anyio.move_on_after(WAIT_S):
        await anyio.sleep_forever()


async def fails_after() -> None:
    with contextlib.suppress(TimeoutError), anyio.fail_after(WAIT_S):
        await anyio.sleep_forever()


async def has_a_timeout() -> None:
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(WAIT_S):
            await asyncio.Event().wait()


async def waits_for() -> None:
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(asyncio.Event().wait(), WAIT_S)


async def cancels_a_scope() -> None:
    with anyio.CancelScope() as scope:
        scope.cancel()
        await anyio.sleep(WAIT_S)


async def cancels_its_group() -> None:
    async with anyio.create_task_group() as group:
        group.start_soon(anyio.sleep_forever)
        await anyio.sleep(WAIT_S)
        group.cancel_scope.cancel()


WAYS = [
    moves_on_after,
    fails_after,
    has_a_timeout,
    waits_for,
    cancels_a_scope,
    cancels_its_group,
]
Way = Callable[[], Awaitable[None]]


async def many(way: Way) -> None:
    for _ in range(TIMES):
        await way()


async def rest(task: TaskContext) -> None:
    await anyio.sleep(TIMES * WAIT_S + 5)


def result_of(robot: RobotProgram, kind: str, *faults: Any) -> SimulationResult:
    needed = ("bad", 1, 1, True) if kind == "bid" else ("bad", 1, 1)
    mission = make_mission(
        action("bad"), {"R1": {"bad": 1.0}, "R2": {"bad": 1.0}}, [task("bad", needed)]
    )
    if kind in ("travel", "travel time"):
        places = {"dock": (0, 0), "home": (0, 0)}
        travel = Travel(places, {"bad": "dock"}, {"R1": "home", "R2": "home"}, {"R1": 1, "R2": 1})
        mission = replace(mission, travel=travel)
    return simulate(mission, robot, seed=1, schedule=faults, timeout_us=200_000_000)


def check_that_nothing_is_wrong(found: SimulationResult, result: str = "success") -> None:
    assert found.result == result
    assert found.summary["failures"] == []
    assert found.summary["problems"] == []
    assert found.summary["faults"] == []


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", ["local task", "background", "travel"])
def test_work_goes_on_after_any_number_of_timeouts(kind: str, way: Way) -> None:
    robot, counted = RobotProgram(), list[str]()
    robot.local_task("bad")(rest)

    async def work(context: RobotContext, *_: str) -> None:
        await many(way)
        counted.append(context.robot)

    if kind == "local task":
        robot = RobotProgram()
        robot.local_task("bad")(work)
    elif kind == "background":
        robot.background(costs="all")(work)
    else:
        robot.travel(work)
    check_that_nothing_is_wrong(result_of(robot, kind))
    assert counted


async def zero() -> None:
    with anyio.move_on_after(0):
        await anyio.sleep(1)


@pytest.mark.parametrize("way", [zero, cancels_a_scope])
@pytest.mark.parametrize("kind", ["bid", "travel time"])
def test_answers_too(kind: str, way: Way) -> None:
    robot, answered = RobotProgram(), list[str]()

    @robot.local_task("bad")
    async def work(task: TaskContext) -> None:
        await anyio.sleep(1)

    async def answer(context: RobotContext, *_: str) -> float:
        await many(way)
        answered.append(context.robot)
        return 1.0

    if kind == "bid":
        robot.bid("bad")(answer)
    else:
        robot.travel_time(answer)
    check_that_nothing_is_wrong(result_of(robot, kind))
    assert answered


@pytest.mark.parametrize("way", WAYS)
def test_so_does_the_cleaning_up_of_work_that_was_cancelled(way: Way) -> None:
    if way is has_a_timeout and sys.version_info < (3, 11, 3):
        pytest.skip("asyncio.timeout of Python 3.11.2 ends the cleaning up itself")
    robot, cleaned = RobotProgram(), list[str]()

    @robot.local_task("bad")
    async def work(task: TaskContext) -> None:
        try:
            await anyio.sleep(5)
        finally:
            if task.robot == "R1" and not cleaned:
                with anyio.CancelScope(shield=True):
                    for _ in range(MAX_SWALLOWED + 1):
                        await way()
                    cleaned.append(task.robot)

    found = result_of(robot, "local task", (2_000_000, Lose("R1", "bad")))
    assert cleaned == ["R1"]
    assert found.result == "success"
    assert found.summary["failures"] == []
    # It takes longer than a robot is given before it is named; it is not ended.
    assert all("still runs" in each["problem"] for each in found.summary["problems"])


MISSION = """\
mission: long
program: robot.py
local_tasks:
  patrol: {tree: patrol.xml, work: 150}
robot_types: {r: {capabilities: {patrol: 1}}}
robots: {R1: r}
global_tasks:
  patrol: {needs: {patrol: {min: 1}}}
tree: patrol
"""
TREE = """\
<root BTCPP_format="4" main_tree_to_execute="P">
  <BehaviorTree ID="P"><ReactiveSequence><Ok/><Drive/></ReactiveSequence></BehaviorTree>
  <TreeNodesModel><Condition ID="Ok"/><Action ID="Drive"/></TreeNodesModel>
</root>
"""
PROGRAM = """\
import anyio
from mrbt_mesh import RobotProgram, TaskContext
robot = RobotProgram()

@robot.condition("Ok")
def ok() -> bool:
    return True

@robot.action("Drive")
async def drive(task: TaskContext) -> None:
    await anyio.sleep(150)
"""


def test_a_tree_may_be_ticked_more_often(tmp_path: Path) -> None:
    """Each tick at the tree's rate is a timeout."""
    for name, text in (("mission.yaml", MISSION), ("patrol.xml", TREE), ("robot.py", PROGRAM)):
        (tmp_path / name).write_text(text)
    found = run(tmp_path / "mission.yaml")
    assert found.result == "success"
    assert found.whole.summary["failures"] == []
