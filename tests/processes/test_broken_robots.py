"""A robot with a bug: it ends itself, others see why, and take its work over."""

from __future__ import annotations

from pathlib import Path

from tests.support.team import EXPLORE, Team

# One of two robots breaks: its agent raises at the next thing that happens.
PROGRAM = """
from pathlib import Path

import anyio

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.agent.agent import Agent

robot = RobotProgram(record_work=True)
begun = Path(__file__).with_name("begun")


def broken(agent, event, now_us):
    raise LookupError("no such robot")


@robot.local_task("explore")
async def explore(task: TaskContext, area: str) -> None:
    if task.robot == "R1":
        begun.write_text(area)
        Agent.handle = broken
        await anyio.sleep_forever()
    while begun.exists() and begun.read_text() == area and not begun.with_name("seen").exists():
        await anyio.sleep(0.01)
"""


def test_a_robot_that_breaks_stops_says_why_and_is_replaced(team: Team, tmp_path: Path) -> None:
    program = tmp_path / "robot.py"
    program.write_text(PROGRAM)
    team.up(EXPLORE, "--program", str(program))
    begun = team.wait_for_event("explore", robot="R1")
    robot = "R1"
    team.wait_for_replacement(begun)
    reason = "broke, a bug of mrbt: LookupError: no such robot (robot.py:"
    team.wait_for_line(f"{robot}: {reason}")
    row = team.status()["robots"][robot]
    assert (row["state"], row["pid"]) == ("dead", None)
    assert row["problems"]["process"].startswith(reason)
    assert reason in team.mrbt("status")
    assert reason in (team.run_dir / f"{robot}.out").read_text()
    stopped = team.log(robot)[-1]
    assert (stopped["event"], stopped["code"]) == ("stopped", 70)
    assert "Traceback" in stopped["error"]
    (tmp_path / "seen").touch()
    code, summary = team.end()
    assert code == 0, team.logs()
    (told,) = [each for each in summary["problems"] if each["robot"] == robot]
    assert told["subject"] == "process"
    assert any(each["robot"] == robot and each["kind"] == "major" for each in summary["faults"])
