"""Programs that block, exit or await what is cancelled, on real processes: named, and alive.

All other ways to misbehave are run in virtual time: tests/runtime/test_user_code_misbehaviour.py.
"""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import anyio
import pytest

import mrbt_mesh
from mrbt_mesh import RobotContext, RobotOptions, RobotProgram, TaskContext
from tests.support.team import EXPLORE, Team

# What the log has of a background function that raises.
PROBLEM = "problem='KeyboardInterrupt (test_misbehaving_programs.py"
PROGRAM = """
import asyncio, time
from pathlib import Path

import anyio

from mrbt_mesh import RobotOptions, RobotContext, RobotProgram, TaskContext

robot = RobotProgram(record_work=True)
seen = Path(__file__).with_name("seen")

@robot.local_task("explore")
async def explore(task: TaskContext, area: str) -> None:
    if task.robot == "R1":
        while not seen.exists():
            time.sleep(0.01)  # line 16
    while not seen.exists():
        await anyio.sleep(0.01)
    future = asyncio.get_running_loop().create_future()
    future.cancel()
    await future  # line 21

@robot.background(costs="none")
async def camera(context: RobotContext) -> None:
    raise SystemExit(3)  # line 25
"""


def test_code_that_blocks_exits_or_is_cancelled(team: Team, tmp_path: Path) -> None:
    program = tmp_path / "robot.py"
    program.write_text(PROGRAM)
    team.up(EXPLORE, "--program", str(program))
    local_task = team.wait_for_event("explore", robot="R1")
    work = f"local task explore({local_task['args'][0]}) at robot.py:16"
    now = f"{work} blocks it now"
    team.wait_for_line(f"R1: program problem, event loop: {now}")
    assert team.status()["robots"]["R1"]["problems"]["event loop"] == now
    (tmp_path / "seen").touch()
    team.wait_for_line(f"R1: program problem, event loop: {work} blocked it for")
    code, summary = team.end()
    assert code == 1, team.logs()
    assert {each["reason"] for each in summary["failures"]} == {
        "CancelledError: the program cancelled it, or what it waited for (robot.py:21)"
    }
    told = {(each["robot"], each["subject"]): each["problem"] for each in summary["problems"]}
    for robot in ("R1", "R2"):
        exited = told[robot, "background function camera"]
        assert exited.startswith("SystemExit: 3 (robot.py:25)")
        assert team.log(robot)[-1]["reason"] == "mission failure"


async def test_inside_a_program_of_ones_own(caplog: pytest.LogCaptureFixture) -> None:
    """Neither does it end the program around the robot."""
    robot = RobotProgram()

    @robot.local_task("explore")
    async def explore(task: TaskContext, area: str) -> None:
        while PROBLEM not in caplog.text:  # the mission would end before it is logged
            await anyio.sleep(0.01)
        future = asyncio.get_running_loop().create_future()
        future.cancel()
        await future

    @robot.background(costs="none")
    async def camera(context: RobotContext) -> None:
        raise KeyboardInterrupt

    with caplog.at_level(logging.ERROR, "mrbt_mesh.R1"):
        async with mrbt_mesh.join_team(
            EXPLORE,
            "R1",
            robot,
            RobotOptions(insecure=True, expect=["R1"], listen=["tcp/127.0.0.1:0"]),
        ) as member:
            assert await member.until_ended() == "failure"
    assert PROBLEM in caplog.text
