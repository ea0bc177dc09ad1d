"""The robots of the workshop: what local tasks are for a body that drives, reaches and lifts.

The same program runs in virtual time (`sim run`, with the world in the same process) and in real
time (`mrbt up`, with the world in its own).
"""

import math
from dataclasses import replace
from importlib.util import find_spec

from bodies.body import Body
from bodies.driving import Place
from bodies.messages import (
    HARDWARE,
    PROBE,
    SCREW,
    SOLDER,
    UNSCREW,
    WIRES,
    AtTip,
)

from mrbt_mesh import InputError, RobotContext, RobotProgram, TaskContext, TaskFailedError

# Robots do not load it, but there is no world without it.
if find_spec("mujoco") is None:
    raise InputError("the workshop's world needs more: pip install 'mrbt-mesh[world]'")

robot = RobotProgram(record_work=True)
bodies: dict[tuple[str, int], Body] = {}

# Where a big robot stands to hold the cover by its grip, from the vehicle's middle, and before.
GRIP_X, APPROACH_X = 2.66, 3.35
OUT_M, DOWN_M, TRIED_M, HIGH_M = 0.4, 0.0, 0.15, 0.32
# A cover that leans less than this is held at both ends.
LEVEL_RAD = 0.005
CARRY_SPEED = 0.5
# What is done of a part, by tools in this order.
DONE = {HARDWARE: 0, WIRES: 1, SOLDER: 2}


def body_of(context: RobotContext) -> Body:
    """The body of the robot that is asked."""
    return bodies.setdefault((context.robot, context.simulation.pid), Body(context))


@robot.background
async def live(context: RobotContext) -> None:
    """Sense and move as long as the robot lives."""
    await body_of(context).live()


@robot.background
async def stand_by(context: RobotContext) -> None:
    """Do not stand in the others' way."""
    await body_of(context).stand_by()


@robot.bid("*")
def bid(task: TaskContext, part: str) -> float:
    """Minus the seconds for the way, as the crow flies, and for the work."""
    body = body_of(task)
    way_s = math.dist(body.place, _part(task, part)) / body.speed
    return -round(way_s + task.simulation.work / task.performance, 2)


def _part(task: TaskContext, part: str) -> Place:
    x, y = task.parameters["map"]["places"][part]["at"]
    return (x, y)


# -- parts -------------------------------------------------------------------------------------


@robot.local_task
async def do_diagnosis(task: TaskContext, part: str) -> None:
    """Measure whether a part is broken."""
    body = body_of(task)
    async with body.at_work():
        await body.reach(_part(task, part))
        tip = await body.apply(PROBE, f"part {part}", lambda tip: bool(tip.reading))
    task.set_condition(f"broken({part})", tip.reading == "broken")


@robot.local_task
async def replace_hw(task: TaskContext, part: str) -> None:
    """Put in a new one; one that was begun by somebody else is finished."""
    await _work(task, part, HARDWARE)


@robot.local_task
async def replace_wires(task: TaskContext, part: str) -> None:
    """Two at it are twice as fast."""
    await _work(task, part, WIRES)


@robot.local_task
async def use_soldering_iron(task: TaskContext, part: str) -> None:
    """Solder its wires."""
    await _work(task, part, SOLDER)


async def _work(task: TaskContext, part: str, tool: str) -> None:
    def is_done(tip: AtTip) -> bool:
        task.report_progress(tip.done[DONE[tool]])
        return tip.done[DONE[tool]] >= 1

    body = body_of(task)
    async with body.at_work():
        await body.reach(_part(task, part))
        await body.apply(tool, f"part {part}", is_done)


# -- screws ------------------------------------------------------------------------------------


@robot.local_task
async def use_screwdriver(task: TaskContext, way: str) -> None:
    """See to it that all screws are out, or in; two robots begin on opposite sides.

    Each looks at all of them: what another one has done is not known before it is seen.
    """
    body, screws = body_of(task), task.parameters["screws"]
    tool, wanted = (UNSCREW, 1.0) if way == "out" else (SCREW, 0.0)
    first = 2 * _number(task)
    async with body.at_work():
        for count in range(len(screws)):
            number = (first + count) % len(screws)
            x, y = screws[number]
            await body.reach((x, y))
            await body.apply(tool, f"screw {number + 1}", lambda tip: tip.done[0] == wanted)
            task.report_progress((count + 1) / len(screws))


def _number(task: TaskContext) -> int:
    """This robot's among those that do the same: all of them count alike."""
    return sorted([task.robot, *task.partners]).index(task.robot)


# -- the cover ---------------------------------------------------------------------------------


@robot.local_task
async def move_frame(task: TaskContext, where: str) -> None:
    """Carry the cover with another robot, each at one end.

    They say nothing to each other. Who has raised its end waits until the cover lies level, so the
    other one has raised its own; from then on both do the same at the same time.
    """
    body, cover = body_of(task), task.parameters["cover"]
    begin_y, end_y = (cover["on"], cover["off"]) if where == "off" else (cover["off"], cover["on"])
    side = (-1, 1)[_number(task) % 2]
    heading = 0.0 if side < 0 else math.pi
    async with body.at_work():
        if not (await body.tick()).is_loaded:
            await _get_under(body, side, begin_y, heading)
        await _raise(body, TRIED_M)
        await _until_level(body)
        task.report_progress(0.3)
        await _raise(body, HIGH_M)
        await _until_level(body)
        await _carry(body, end_y, heading)
        task.report_progress(0.8)
        await _raise(body, DOWN_M)
        await body.settle((side * APPROACH_X, end_y), heading)
        body.command = replace(body.command, reach_m=0.0)


async def _get_under(body: Body, side: int, y: float, heading: float) -> None:
    """Stand where the fork is below the cover's grip."""
    before = (side * APPROACH_X, y)
    while True:
        body.command = replace(body.command, reach_m=0.0, fork_m=DOWN_M)
        await body.drive([before], facing=(0.0, y))
        if await body.settle(before, heading):
            body.command = replace(body.command, reach_m=OUT_M)
            if await body.settle((side * GRIP_X, y), heading):
                return


async def _raise(body: Body, up_m: float) -> None:
    body.command = replace(body.command, fork_m=up_m)
    while True:
        senses = await body.tick()
        assert senses.fork is not None
        if abs(senses.fork.up_m - up_m) < 0.02:
            return


async def _until_level(body: Body) -> None:
    """Wait for the other end. Raises TaskFailedError if nothing lies on the fork."""
    calm = empty = 0
    while calm < 6:
        senses = await body.tick()
        assert senses.fork is not None
        is_level = senses.is_loaded and abs(senses.fork.tilt_rad) < LEVEL_RAD
        calm = calm + 1 if is_level else 0
        empty = 0 if senses.is_loaded else empty + 1
        if empty > 60:
            raise TaskFailedError("there is no cover on the fork")


async def _carry(body: Body, end_y: float, heading: float) -> None:
    """Along the lane at a speed that both keep; then stand until the other one stands as well."""
    senses = await body.tick()
    x, y, begun_s = senses.x, senses.y, senses.time_s
    needed_s = abs(end_y - y) / CARRY_SPEED
    while senses.time_s - begun_s < needed_s + 2.0:
        gone = min(1.0, (senses.time_s - begun_s) / needed_s) if needed_s else 1.0
        body.steer(senses, (x, y + gone * (end_y - y)), heading, speed=2 * CARRY_SPEED)
        senses = await body.tick()
    body.stop()
