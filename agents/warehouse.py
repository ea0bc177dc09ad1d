"""The simulated vehicles of examples/warehouse: they drive straight, and bid how near they are.

agvs.py is the same for real ones.
"""

import math

import anyio
from simulated import held

from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram(record_work=True)
Place = tuple[float, float]
SPEED, STEP_S, HANDLING_S = 2.0, 0.1, 1.0

# Where each vehicle is. Simulated ones share this module.
here: dict[tuple[str, int], Place] = {}


@robot.background
async def set_out(context: RobotContext) -> None:
    """A vehicle that starts, or starts again, does so at its station."""
    x, y = context.parameters["map"]["stations"][context.robot]
    here[context.robot, context.simulation.pid] = (x, y)
    context.report_position(x, y)


@robot.bid("*")
def bid(task: TaskContext, *places: str) -> float:
    """Minus the metres to drive."""
    way = [here[task.robot, task.simulation.pid], *(_place(task, name) for name in places)]
    gone = sum(math.dist(way[index], way[index + 1]) for index in range(len(way) - 1))
    return -round(gone, 2)


@robot.local_task
async def count(task: TaskContext, rack: str) -> None:
    """Look at what lies in a rack."""
    await held(task)
    await _visit(task, rack, 0.0, 1.0)
    task.set_condition(f"counted({rack})", True)


@robot.local_task
async def deliver(task: TaskContext, rack: str, dock: str) -> None:
    """Bring a pallet from a rack to a dock."""
    await held(task)
    await _visit(task, rack, 0.0, 0.5)
    await _visit(task, dock, 0.5, 1.0)


async def _visit(task: TaskContext, name: str, before: float, after: float) -> None:
    start, end = here[task.robot, task.simulation.pid], _place(task, name)
    seconds = math.dist(start, end) / (SPEED * task.simulation.speed)
    steps = max(1, round(seconds / STEP_S))
    heading = math.atan2(end[1] - start[1], end[0] - start[0])
    for step in range(1, steps + 1):
        await anyio.sleep(seconds / steps)
        gone = step / steps
        x, y = (a + gone * (b - a) for a, b in zip(start, end, strict=True))
        here[task.robot, task.simulation.pid] = (x, y)
        task.report_position(x, y, heading=heading)
        task.report_progress(before + gone * (after - before))
    await anyio.sleep(HANDLING_S / task.simulation.speed)


def _place(task: TaskContext, name: str) -> Place:
    x, y = task.parameters["map"]["places"][name]["at"]
    return x, y
