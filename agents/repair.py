"""The robots of examples/vehicle_repair: diagnosis finds out what is broken, the rest is work."""

from simulated import work

from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram(record_work=True)
# How near a robot comes to what it works on, as a share of its way there.
NEAR = 0.7


def go(context: RobotContext, *place: str) -> None:
    """Say where this robot is: beside a part of the vehicle, or (without one) at its station."""
    town = context.parameters.get("map", {})
    station = town.get("stations", {}).get(context.robot)
    if station is None:
        return
    part = town["places"].get(place[0] if place else "", {"at": station})["at"]
    x, y = (s + NEAR * (p - s) for s, p in zip(station, part, strict=True))
    context.report_position(x, y)


@robot.background
async def stand_by(context: RobotContext) -> None:
    """A robot starts at its station."""
    go(context)


@robot.local_task
async def do_diagnosis(task: TaskContext, part: str) -> None:
    """Find out whether `part` is broken, and say so together with this task's outcome."""
    go(task, part)
    await work(task)
    broken_parts = {str(broken) for broken in task.parameters.get("broken_parts", [])}
    task.set_condition(f"broken({part})", part in broken_parts)


@robot.local_task("use_screwdriver")
@robot.local_task("move_frame")
@robot.local_task("replace_hw")
@robot.local_task("replace_wires")
@robot.local_task("use_soldering_iron")
async def do_work(task: TaskContext, *arguments: str) -> None:
    """Anything that only takes its time."""
    go(task, *arguments)
    await work(task)
