"""What a robot of this team can do: driving, and one async function per local task."""

import math

import anyio

from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram(record_work=True)  # starts and ends are in the run's events.jsonl
STEP_S = 0.1

# Where each robot is; a real one would ask its localisation.
here: dict[str, tuple[float, float]] = {}


@robot.background
async def localise(context: RobotContext) -> None:
    """Runs beside all tasks, from when the robot starts."""
    x, y = context.parameters["map"]["places"]["home"]["at"]
    here[context.robot] = (x, y)
    context.report_position(x, y)


@robot.travel
async def drive(task: TaskContext, place: str) -> None:
    """Go to the place. When the plan changes, any await may be cancelled."""
    goal = task.parameters["map"]["places"][place]["at"]
    start = here[task.robot]
    seconds = math.dist(start, goal) / task.simulation.speed
    steps = max(1, round(seconds / STEP_S))
    for step in range(1, steps + 1):
        await anyio.sleep(seconds / steps)  # in place of wheels
        share = step / steps
        x, y = (a + (b - a) * share for a, b in zip(start, goal, strict=True))
        here[task.robot] = (x, y)
        task.report_position(x, y)


@robot.local_task
async def take(task: TaskContext, shelf: str, boxes: int) -> None:
    """To fail: raise, with the reason."""
    await anyio.sleep(task.simulation.duration_s)  # in place of a gripper


@robot.local_task
async def hand_over(task: TaskContext, shelf: str, boxes: int) -> None:
    """The job is done when this returns."""
    await anyio.sleep(task.simulation.duration_s)
