"""Faults and commands that people name, on the command line or in tests: what cannot happen is
refused.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from mrbt_mesh.core.mission.jobs import arguments_in
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import ALL, type_name
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.sim.world import faults


@dataclass(frozen=True)
class NamedFault:
    """A fault, when it comes, and how it was written: `--kill A1@12.5`."""

    at_us: int
    fault: faults.Fault
    said: str


def local_task_names(mission: Mission) -> set[str]:
    """All that the mission asks robots for: ground local tasks, and their types."""
    grounds = {need.local_task for task in mission.all_tasks() for need in task.needs}
    return grounds | {type_name(name) for name in grounds} | mission.local_tasks.keys()


def is_local_task(mission: Mission, name: str) -> bool:
    """Whether the mission asks robots for a local task of this name (a type, or ground), in the
    tree of a job, too.
    """
    if name in local_task_names(mission):
        return True
    for kind in mission.jobs.values():
        for task in kind.global_tasks.values():
            for need in task.needs:
                values = arguments_in(need.local_task, name)
                known = [each for each in kind.parameters if each.name in (values or ())]
                if values is not None and not any(p.problem(values[p.name]) for p in known):
                    return True
    return False


def check_number(name: str, value: Any, most: float = math.inf) -> None:
    """Raise InputError unless it is a finite number from 0 to `most`."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or not 0 <= value <= most:
        limit = "" if most == math.inf else f" to {most:g}"
        raise InputError(f"{name}: a number from 0{limit} is expected, not {value!r:.80}")


def check_robot(mission: Mission, robot: str, said: str) -> None:
    """Raise InputError for a robot that the mission does not have."""
    if robot not in mission.robots:
        hint = nearest(robot, mission.robots)
        raise InputError(f"{said}: mission {mission.name} has no robot {robot!r}{hint}")


def check_local_task(mission: Mission, robot: str, local_task: str, said: str) -> None:
    """Raise InputError for a local task (a type, ground, or all) that the robot does not have."""
    types = {type_name(name) for name in mission.robots[robot].capabilities}
    known = {name for name in local_task_names(mission) if type_name(name) in types} | {ALL}
    is_its_own = type_name(local_task) in types and is_local_task(mission, local_task)
    if local_task not in known and not is_its_own:
        hint = nearest(local_task, known)
        raise InputError(f"{said}: {robot} has no local task {local_task!r}{hint}")


def check_faults(found: Sequence[NamedFault], team: Collection[str], timeout_s: float) -> None:
    """Raise InputError for a fault that cannot come to pass, e.g. of a robot that does not run.

    `found` is sorted by time; `team` are the robots that run from the beginning.
    """
    running, frozen = set(team), set[str]()
    for named in found:
        if named.at_us >= timeout_s * 1e6:
            limit = f"the run is given up at {timeout_s:g} s"
            raise InputError(f"{named.said}: {limit}; give it a longer timeout")
        fault = named.fault
        if not isinstance(fault, faults.RobotFault):
            continue
        robot = fault.robot
        if isinstance(fault, faults.Restart):
            running.add(robot)
            frozen.discard(robot)
            continue
        if robot not in running:
            text = f"{robot} does not run at that time; restart it before"
            raise InputError(f"{named.said}: {text}")
        if isinstance(fault, faults.Thaw) and robot not in frozen:
            raise InputError(f"{named.said}: {robot} is not frozen at that time")
        match fault:
            case faults.Kill() | faults.Leave():
                running.discard(robot)
                frozen.discard(robot)
            case faults.Freeze():
                frozen.add(robot)
            case faults.Thaw():
                frozen.discard(robot)


def missed(found: Sequence[NamedFault], ended_us: int) -> Iterator[str]:
    """What was asked for after the run had ended, in words."""
    for named in found:
        if named.at_us > ended_us:
            yield f"{named.said}: the run had ended before, at {ended_us / 1e6:.2f} s"
