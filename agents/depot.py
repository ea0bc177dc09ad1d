"""The robots of examples/depot and examples/deliveries: they drive to places, and work there."""

import math

import anyio
from simulated import held, work

from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram(record_work=True)
STEP_S = 0.1

# Where each robot is; a real one would ask its localisation. Simulated ones share this module.
here: dict[tuple[str, int], tuple[float, float]] = {}


@robot.background
async def set_out(context: RobotContext) -> None:
    """A robot that starts, or starts again, is at its station."""
    x, y = context.parameters["map"]["places"][context.parameters["stations"][context.robot]]["at"]
    here[context.robot, context.simulation.pid] = (x, y)
    context.report_position(x, y)


@robot.travel
async def drive(task: TaskContext, place: str) -> None:
    """Go straight to the place. A robot that is needed elsewhere is stopped on its way."""
    await held(task)
    me = task.robot, task.simulation.pid
    start, (goal_x, goal_y) = here[me], task.parameters["map"]["places"][place]["at"]
    ahead = goal_x - start[0], goal_y - start[1]
    speed = task.parameters["speeds"][task.robot_type] * task.simulation.speed
    seconds = math.hypot(*ahead) / speed
    steps = max(1, round(seconds / STEP_S))
    for step in range(1, steps + 1):
        await anyio.sleep(seconds / steps)
        here[me] = start[0] + ahead[0] * step / steps, start[1] + ahead[1] * step / steps
        task.report_position(*here[me], heading=math.atan2(ahead[1], ahead[0]))


@robot.local_task("*")
async def do(task: TaskContext, place: str, boxes: int = 0) -> None:
    """Work takes its time, for any number of boxes."""
    await work(task)
