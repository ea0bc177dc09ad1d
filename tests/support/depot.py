"""A team that drives: from home to docks a (4 s) and b (6 s), and between these (10 s)."""

from __future__ import annotations

from pathlib import Path

import anyio

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.build import mission_from_yaml

SECOND = 1_000_000
TEXT = """
mission: depot
travel: {places: {a: [0, 0], b: [10, 0], home: [4, 0]}, speed: 1, start: home}
local_tasks:
  lift: {parameters: [dock], work: 2, at: $dock}
  scan: {parameters: [dock], work: 1, at: $dock}
robot_types: {mover: {capabilities: {lift: 1, scan: 1}}}
robots: {R1: mover, R2: mover, R3: mover}
global_tasks:
  lift_at: {parameters: [dock], simultaneous: true, needs: {lift($dock): {min: 2, max: 2}}}
  scan_at: {parameters: [dock], needs: {scan($dock): {}}}
tree: {TREE}
"""


def depot(tree: str) -> Mission:
    """The team with a tree of `lift_at(a)`, `scan_at(b)` and the like."""
    return mission_from_yaml(TEXT.replace("TREE", tree), "depot", Path())


def worker() -> RobotProgram:
    """It does not drive by itself."""
    program = RobotProgram(record_work=True)

    @program.local_task("*")
    async def work(task: TaskContext, *arguments: str) -> None:
        await anyio.sleep(task.simulation.duration_s)

    return program
