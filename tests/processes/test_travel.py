"""Robots that drive to the place of a task, on real processes: one is killed on its way."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.support.team import Team

MISSION = """
mission: dock
program: robot.py
travel: {places: {dock: [0, 0], home: [3, 0]}, speed: 1, start: home}
local_tasks: {lift: {work: 1, at: dock}}
robot_types: {mover: {capabilities: {lift: 1}}}
robots: {R1: mover, R2: mover, R3: mover}
global_tasks: {load: {simultaneous: true, needs: {lift: {min: 2, max: 2}}}}
tree: load
"""
PROGRAM = """
from pathlib import Path

import anyio

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)
is_open = Path(__file__).with_name("is_open")

@robot.travel
async def drive(task: TaskContext, place: str) -> None:
    while not is_open.exists():
        await anyio.sleep(0.01)

@robot.local_task("lift")
async def lift() -> None:
    pass
"""


def test_a_robot_that_is_killed_on_its_way_is_replaced(team: Team, tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(MISSION)
    (tmp_path / "robot.py").write_text(PROGRAM)
    team.up(mission)
    first, second = team.wait_for_events(2, "lift", "start")
    assert first["place"] == second["place"] == "dock"
    for robot in (first["robot"], second["robot"]):
        team.wait_for_line(f"{robot}: on its way to dock for lift")
    row = team.status()["robots"][second["robot"]]
    assert (row["phase"], row["under_way"]) == ("travelling", "dock")
    assert "lift (on its way to dock)" in team.mrbt("status", "--run-dir", str(team.run_dir))
    team.signal(first["robot"], signal.SIGKILL)
    third = team.wait_for_events(3, "lift", "start")[2]
    assert {first["robot"], second["robot"], third["robot"]} == {"R1", "R2", "R3"}
    (tmp_path / "is_open").touch()
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success")
    told = [(e["robot"], e["event"]) for e in team.events() if e["event"] != "start"]
    pair = {second["robot"], third["robot"]}
    assert {robot for robot, event in told if event == "begin"} == pair
    assert {robot for robot, event in told if event == "end"} == pair
    assert len(told) == 4
