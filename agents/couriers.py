"""The couriers of examples/couriers: a bid is the time that a delivery would take, as a cost."""

import math

import anyio
from simulated import held

from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram(record_work=True)
Place = tuple[float, float]
STEP_S = 0.1

# Where each courier is; a real one would ask its localisation. Simulated ones share this module.
here: dict[tuple[str, int], Place] = {}


@robot.background
async def set_out(context: RobotContext) -> None:
    """A courier that starts, or starts again, does so at its station."""
    x, y = context.parameters["stations"][context.robot]
    here[context.robot, context.simulation.pid] = (x, y)
    context.report_position(x, y)


@robot.bid("deliver")
def bid(task: TaskContext, parcel: str) -> float:
    """Minus the seconds to the parcel and from there to its destination."""
    pick_up, destination = _places(task, parcel)
    start = here[task.robot, task.simulation.pid]
    way = math.dist(start, pick_up) + math.dist(pick_up, destination)
    return -round(way / task.performance, 2)


@robot.local_task
async def deliver(task: TaskContext, parcel: str) -> None:
    """Go to the parcel, and with it to its destination."""
    await held(task)
    for share, place in enumerate(_places(task, parcel)):
        await _go(task, place, share / 2)


async def _go(task: TaskContext, place: Place, done: float) -> None:
    start = here[task.robot, task.simulation.pid]
    seconds = math.dist(start, place) / (task.performance * task.simulation.speed)
    steps = max(1, round(seconds / STEP_S))
    heading = math.atan2(place[1] - start[1], place[0] - start[0])
    for step in range(1, steps + 1):
        await anyio.sleep(seconds / steps)
        gone = step / steps
        here[task.robot, task.simulation.pid] = (
            start[0] + gone * (place[0] - start[0]),
            start[1] + gone * (place[1] - start[1]),
        )
        task.report_position(*here[task.robot, task.simulation.pid], heading=heading)
        task.report_progress(done + gone / 2)


def _places(task: TaskContext, parcel: str) -> tuple[Place, Place]:
    (from_x, from_y), (to_x, to_y) = task.parameters["parcels"][parcel]
    return (from_x, from_y), (to_x, to_y)
