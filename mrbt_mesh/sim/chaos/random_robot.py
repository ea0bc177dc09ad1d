"""The robots of generated missions: work that takes time, fails now and then, sets conditions.

The mission file's parameters determine their behaviour:

    parameters:
      salt: 7
      tasks:
        t1: {fails_permille: 200, raises: true, sets: {c0: true}, loses: 30}
        t2: {bid: {no_permille: 100, fails_permille: 100, late_permille: 100}}
        t3: {fails_on: [R2]}       # always
        t4: {values: {found: [a, b]}}  # sets an entry to one of these, by the salt
      sensors:
        R1: [[1.5, c0, true]]      # seconds after the robot's start
      losses:
        R3: [[2.0, t3]]            # likewise: it loses the capability
      ways: {most_s: 1.5, fails_permille: 50}  # of robots that drive by themselves

Whether a local task fails is decided by the salt, the robot and the activation: the same work
by the same robot always ends the same way, however often it is begun.
"""

from __future__ import annotations

import hashlib

import anyio

from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram()
# The same, but it drives by itself.
driver = RobotProgram()
STEPS = 3
DISTANCES = 4
LATE_S = 0.7


def _drawn(context: RobotContext, *texts: str) -> int:
    text = "/".join((str(context.parameters.get("salt", 0)), *texts))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "big")


def _permille(task: TaskContext, purpose: str) -> int:
    return _drawn(task, purpose, task.robot, task.activation, task.local_task) % 1_000


def _record(task: TaskContext, event: str, outcome: str | None = None) -> None:
    task.record_event(
        {
            "t": task.unix_time_s(),
            "robot": task.robot,
            "pid": task.simulation.pid,
            "event": event,
            "outcome": outcome,
            "activation": task.activation,
            "local_task": task.local_task,
        }
    )


@robot.local_task("*")
@driver.local_task("*")
async def work(task: TaskContext, *arguments: str) -> bool:
    """Take as long as this robot needs, then end as the mission file determines."""
    behaviour = task.parameters.get("tasks", {}).get(task.local_task.partition("(")[0], {})
    _record(task, "start")
    try:
        for step in range(1, STEPS + 1):
            await anyio.sleep(task.simulation.duration_s / STEPS)
            task.report_progress(step / STEPS)
    except BaseException:
        _record(task, "cancel")
        raise
    success = bool(_permille(task, "fails") >= behaviour.get("fails_permille", 0))
    success = success and task.robot not in behaviour.get("fails_on", ())
    _record(task, "end", "success" if success else "failure")
    if _permille(task, "loses") < behaviour.get("loses_permille", 0):
        task.lose_capability(task.local_task.partition("(")[0])
    if not success and behaviour.get("raises", False):
        raise RuntimeError(f"{task.local_task} broke")
    if success:
        for name, value in behaviour.get("sets", {}).items():
            task.set_condition(name, value)
        for name, choices in behaviour.get("values", {}).items():
            task.set_value(name, choices[_permille(task, name) % len(choices)])
    return success


@driver.travel
async def drive(task: TaskContext, place: str) -> None:
    """Take some time to get there, and fail as the mission file determines."""
    ways = task.parameters["ways"]
    await anyio.sleep(_permille(task, "way") * ways["most_s"] / 1_000)
    if _permille(task, "way fails") < ways["fails_permille"]:
        task.update_travel_times()
        raise RuntimeError(f"the way to {place} is blocked")


@driver.travel_time
async def seconds(context: RobotContext, origin: str, goal: str) -> float | None:
    """Some robots cannot say how long their ways take, and some do not know all of them."""
    kind = _drawn(context, "map", context.robot) % 4
    if not kind:
        raise RuntimeError(f"{context.robot} has lost its map")
    drawn = _drawn(context, "ways", context.robot, origin, goal)
    await anyio.sleep(drawn % 3 / 100)
    return None if kind == 1 and drawn % 2 else drawn % 3_000 / 1_000


@robot.bid("*")
@driver.bid("*")
async def bid(task: TaskContext, *arguments: str) -> float | None:
    """A travel cost from one of a few distances, so that many assignments are equally good.

    Some make no bid, some raise, and some take longer than the time for bids.
    """
    behaviour = task.parameters.get("tasks", {}).get(task.local_task.partition("(")[0], {})
    chances, drawn = behaviour.get("bid", {}), _permille(task, "bids")
    for kind in ("no", "fails", "late"):
        drawn -= chances.get(f"{kind}_permille", 0)
        if drawn < 0:
            if kind == "no":
                return None
            if kind == "fails":
                raise RuntimeError(f"{task.robot} has lost its map")
            await anyio.sleep(LATE_S)
            break
    return -float(_permille(task, "distance") % DISTANCES)


@robot.background
@driver.background
async def lose(context: RobotContext) -> None:
    """Lose capabilities at set times, whether they were ever asked for or not."""
    passed_s = 0.0
    for at_s, name in context.parameters.get("losses", {}).get(context.robot, []):
        await anyio.sleep(max(0.0, at_s - passed_s))
        passed_s = max(passed_s, at_s)
        context.lose_capability(name)


@robot.background
@driver.background
async def sense(context: RobotContext) -> None:
    """Set conditions and entries at set times."""
    passed_s = 0.0
    for at_s, name, value in context.parameters.get("sensors", {}).get(context.robot, []):
        await anyio.sleep(max(0.0, at_s - passed_s))
        passed_s = max(passed_s, at_s)
        if isinstance(value, bool):
            context.set_condition(name, value)
        else:
            context.set_value(name, value)
