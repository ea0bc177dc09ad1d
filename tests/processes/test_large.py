"""A mission so large that its robots make their plans beside the event loop."""

from __future__ import annotations

import signal
from pathlib import Path

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.robot_process import LARGE_NODES
from tests.support.paths import ROOT
from tests.support.team import Team

MISSION = """
mission: large
program: {program}
parameters:
  places: [{places}]
local_tasks:
  visit: {{parameters: [place], work: 1}}
  finish: {{work: 1}}
conditions:
  closed: {{parameters: [place], default: true}}
robot_types:
  walker:
    capabilities: {{visit: 1, finish: 1}}
robots: {{W1: walker, W2: walker, W3: walker}}
global_tasks:
  visit:
    parameters: [place]
    needs:
      visit($place): {{min: 1, max: 1}}
  finish:
    needs:
      finish: {{min: 1, max: 1}}
tree:
  Sequence:
    - Parallel:
        success: all
        for_each: {{place: $places}}
        do:
          Fallback:
            - Condition: closed($place)
            - visit($place)
    - visit(here)
    - visit(there)
    - finish
"""

PROGRAM = """
import sys

sys.path.insert(0, "{agents}")

from simulated import work

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)


@robot.local_task("visit")
async def visit(task: TaskContext, place: str) -> None:
    await work(task)


@robot.local_task("finish")
async def finish(task: TaskContext) -> None:
    await work(task)
"""


def test_a_robot_that_dies_is_replaced(team: Team, tmp_path: Path) -> None:
    places = ", ".join(f"p{number}" for number in range(LARGE_NODES // 3 + 1))
    program, mission = tmp_path / "walk.py", tmp_path / "mission.yaml"
    program.write_text(PROGRAM.format(agents=ROOT / "agents"))
    mission.write_text(MISSION.format(program=program, places=places))
    assert len(load_mission(mission).tree.nodes) >= LARGE_NODES
    team.hold("visit")
    team.up(mission)
    victim = team.wait_for_work(team.wait_for_event("visit"))
    team.signal(victim["robot"], signal.SIGKILL)
    team.wait_for_replacement(victim)
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["result"] == "success"
    assert [fault["robot"] for fault in summary["faults"]] == [victim["robot"]]
