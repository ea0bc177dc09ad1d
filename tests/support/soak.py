"""A team in which every executor of a robot's program works for as long as one likes."""

from __future__ import annotations

from pathlib import Path

MISSION = """\
mission: soak
program: robot.py
ends: never
conditions: {wanted: {default: true}, full: {default: false}}
travel:
  places: {dock: [0, 0], field: [60, 0]}
  speed: {bot: 1}
  start: {T: dock}
  horizon: 1
local_tasks:
  plain: {work: 120}
  patrol: {tree: patrol.xml, work: 240}
  at_dock: {work: 30, at: dock}
  at_field: {work: 30, at: field}
  offered: {work: 60}
robot_types:
  plain: {capabilities: {plain: 1, offered: 1}}
  tree: {capabilities: {patrol: 1}}
  bot: {capabilities: {at_dock: 1, at_field: 1}}
robots: {P: plain, B: tree, T: bot}
global_tasks:
  plain: {needs: {plain: {min: 1}}}
  offered: {needs: {offered: {min: 1, performance: bid}}}
  patrol: {needs: {patrol: {min: 1}}}
  at_dock: {needs: {at_dock: {min: 1}}}
  at_field: {needs: {at_field: {min: 1}}}
tree:
  Parallel:
    - Repeat: {cycles: -1, do: {Sequence: [{Condition: wanted}, plain, offered]}}
    - Repeat: {cycles: -1, do: patrol}
    - Repeat: {cycles: -1, do: {Sequence: [at_dock, at_field]}}
"""
PATROL = """\
<root BTCPP_format="4" main_tree_to_execute="Patrol">
  <BehaviorTree ID="Patrol">
    <ReactiveSequence><Ok/><Sequence>
      <ForceSuccess><Timeout msec="TIMEOUT"><Drive seconds="120"/></Timeout></ForceSuccess>
      <Drive seconds="120"/>
    </Sequence></ReactiveSequence>
  </BehaviorTree>
  <TreeNodesModel>
    <Condition ID="Ok"/>
    <Action ID="Drive"><input_port name="seconds" type="double"/></Action>
  </TreeNodesModel>
</root>
"""
PROGRAM = """\
import asyncio

import anyio

from mrbt_mesh import RobotContext, RobotProgram, TaskContext, TaskFailedError

SPEED = {speed}
robot = RobotProgram(record_work=True)


async def wait(seconds: float) -> None:
    await anyio.sleep(seconds / SPEED)


@robot.local_task
async def plain(task: TaskContext) -> None:
    for step in range(60):  # looks at a queue that is empty
        with anyio.move_on_after(2 / SPEED):
            await asyncio.Event().wait()
        task.report_progress(step / 60)


@robot.local_task
async def offered(task: TaskContext) -> None:
    await wait(60)


@robot.bid("offered")
async def offer(task: TaskContext) -> float:
    with anyio.move_on_after(0.01):
        await asyncio.Event().wait()
    return 1.0


@robot.local_task("at_dock")
@robot.local_task("at_field")
async def at_place(task: TaskContext) -> None:
    await wait(30)


@robot.travel
async def drive(task: TaskContext, place: str) -> None:
    for metre in range(60):
        task.report_position(metre, 0)
        await wait(1)


@robot.travel_time
async def travel_time(context: RobotContext, start: str, goal: str) -> float:
    return 60 / SPEED


@robot.condition("Ok")
async def ok() -> bool:
    await asyncio.sleep(0)
    return True


@robot.action("Drive")
async def drive_on(seconds: float) -> None:
    await wait(seconds)


@robot.background(costs="none")
async def sensor(context: RobotContext) -> None:
    looked = 0
    while True:
        with anyio.move_on_after(10 / SPEED):
            await asyncio.Event().wait()
        looked += 1
        context.set_condition("full", looked % 2 == 0)
        if looked % 100 == 0:
            context.update_travel_times()
"""


def write_mission(folder: Path, speed: float = 1.0) -> Path:
    """The mission file, its tree and its program, which works `speed` times as fast."""
    (folder / "robot.py").write_text(PROGRAM.format(speed=speed))
    (folder / "patrol.xml").write_text(PATROL.replace("TIMEOUT", f"{60_000 / speed:.0f}"))
    file = folder / "mission.yaml"
    file.write_text(MISSION)
    return file
