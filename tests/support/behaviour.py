"""Robots that do as the mission's parameters say, so that a test says it all in one text.

    parameters:
      behave:
        a: {seconds: 2, fails: [R1], sets: {lid: true}}    # of a local task; fails: true for all
        b@R2: {seconds: 9}                                 # only of this robot
        c: {fails: true, reason: no path}                  # what it says of why
        d: {sets: {"holding({0})": true}}                  # {0}: its first argument
        e: {values: {found: red}}                          # entries of the blackboard

Whatever is left out takes one second and succeeds.
"""

from __future__ import annotations

from pathlib import Path

import anyio

from mrbt_mesh import RobotProgram, TaskContext, TaskFailedError
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.sim import SimulationResult

robot = RobotProgram()


def mission_of(text: str) -> Mission:
    """The mission in a text; one line for each robot, global task and so on will do."""
    return mission_from_yaml(text, "mission of a test", Path())


def starts(result: SimulationResult) -> list[tuple[str, str]]:
    """(robot, local task) for each action that was begun, in order."""
    return [(e["robot"], e["local_task"]) for e in result.events if e["event"] == "start"]


def ends(result: SimulationResult, local_task: str) -> list[tuple[str, str]]:
    """(robot, how it ended) for each action of a local task: success, failure or cancel."""
    found = [e for e in result.events if e["local_task"] == local_task and e["event"] != "start"]
    return [(event["robot"], event["event"]) for event in found]


@robot.local_task("*")
async def work(task: TaskContext, *arguments: str) -> bool:
    """Take some time, then end as the parameters say."""
    behave = task.parameters.get("behave", {})
    kind = type_name(task.local_task)
    how = behave.get(f"{kind}@{task.robot}", behave.get(kind, {}))
    _record(task, "start")
    try:
        await anyio.sleep(how.get("seconds", 1.0) / task.simulation.speed)
    except BaseException:
        _record(task, "cancel")
        raise
    fails = how.get("fails", [])
    success = not (fails if isinstance(fails, bool) else task.robot in fails)
    _record(task, "success" if success else "failure")
    if success:
        for name, value in how.get("sets", {}).items():
            task.set_condition(name.format(*arguments), value)
        for name, value in how.get("values", {}).items():
            task.set_value(name, value)
    elif "reason" in how:
        raise TaskFailedError(how["reason"])
    return success


def _record(task: TaskContext, event: str) -> None:
    line = {"t": task.unix_time_s(), "robot": task.robot, "local_task": task.local_task}
    task.record_event({**line, "activation": task.activation, "event": event})
