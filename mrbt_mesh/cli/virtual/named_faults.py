"""Faults as `mrbt sim` is told them, ROBOT[:LOCAL_TASK[=X]]@SECONDS: read, checked in order."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from mrbt_mesh.core.mission.mission import (
    MAX_PERFORMANCE,
    MICRO,
    Mission,
    micro_performance,
    performance,
)
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.errors import InputError
from mrbt_mesh.sim.engine import faults

_WHEN = re.compile(r"(?P<what>[^@]+)@(?P<at_s>\d+(?:\.\d+)?)", re.ASCII)
# Later than any run lasts.
NEVER_S = 1e12
# A comma between two faults, not one between the arguments of a local task.
_COMMA = re.compile(r",(?![^(]*\))")
RobotFault: TypeAlias = (
    faults.Kill
    | faults.Restart
    | faults.Freeze
    | faults.Thaw
    | faults.Leave
    | faults.Lose
    | faults.Restore
    | faults.Perform
)
_OF_A_ROBOT: dict[str, Callable[[str], RobotFault]] = {
    "--kill": faults.Kill,
    "--restart": faults.Restart,
    "--freeze": faults.Freeze,
    "--thaw": faults.Thaw,
    "--leave": faults.Leave,
}


@dataclass(frozen=True)
class NamedFault:
    """A fault, when it comes, and how it was written: `--kill A1@12.5`."""

    at_us: int
    fault: RobotFault
    said: str


def read_faults(mission: Mission, texts: Mapping[str, Sequence[str]]) -> list[NamedFault]:
    """The faults of all options, by time. `texts`: option -> what was given for it.

    Raises InputError for what is no fault of this mission's robots.
    """
    found = [
        _fault(mission, option, part.strip())
        for option, given in texts.items()
        for text in given
        for part in _COMMA.split(text)
    ]
    return sorted(found, key=lambda fault: fault.at_us)


def _fault(mission: Mission, option: str, text: str) -> NamedFault:
    said = f"{option} {text}"
    match = _WHEN.fullmatch(text)
    if match is None:
        raise InputError(f"{said}: expected ROBOT@SECONDS, e.g. A1@12.5")
    robot, colon, local_task = match["what"].partition(":")
    at_us = round(min(float(match["at_s"]), NEVER_S) * 1e6)
    if robot not in mission.robots:
        raise InputError(f"{said}: no robot {robot!r} ({', '.join(sorted(mission.robots))})")
    if option in _OF_A_ROBOT:
        if colon:
            raise InputError(f"{said}: only --fault, --restore, --performance name a local task")
        return NamedFault(at_us, _OF_A_ROBOT[option](robot), said)
    if option == "--performance":
        return NamedFault(at_us, _performance(mission, robot, local_task, said), said)
    if not local_task and (colon or option == "--fault"):
        raise InputError(f"{said}: which local task? e.g. {robot}:all@4")
    _check_local_task(mission, robot, local_task, said)
    make = faults.Lose if option == "--fault" else faults.Restore
    return NamedFault(at_us, make(robot, local_task or "all"), said)


def _performance(mission: Mission, robot: str, text: str, said: str) -> faults.Perform:
    local_task, equals, number = text.rpartition("=")
    if not equals or local_task in ("", "all"):
        raise InputError(f"{said}: of which local task? e.g. {robot}:LOCAL_TASK=0.5@4")
    try:
        value = micro_performance(float(number))
    except ValueError:
        problem = f"a performance from 0 to {MAX_PERFORMANCE // MICRO} expected"
        raise InputError(f"{said}: {problem}, found {number!r}") from None
    _check_local_task(mission, robot, local_task, said)
    return faults.Perform(robot, local_task, value)


def _check_local_task(mission: Mission, robot: str, local_task: str, said: str) -> None:
    own = mission.robots[robot].capabilities
    types = {type_name(name) for name in own}
    if local_task in ("", "all") or type_name(local_task) in types:
        return
    if performance(own, local_task) is None:
        listed = ", ".join(sorted(own))
        raise InputError(f"{said}: {robot} has no local task {local_task!r} ({listed})")


def check_faults(found: Sequence[NamedFault], team: Collection[str], timeout_s: float) -> None:
    """Raise InputError for a fault that cannot come to pass, e.g. of a robot that does not run.

    `found` is sorted by time; `team` are the robots that run from the beginning.
    """
    running, frozen = set(team), set[str]()
    for named in found:
        if named.at_us >= timeout_s * 1e6:
            raise InputError(f"{named.said}: the run is given up at {timeout_s:g} s (--timeout)")
        fault = named.fault
        robot = fault.robot
        if isinstance(fault, faults.Restart):
            running.add(robot)
            frozen.discard(robot)
            continue
        if robot not in running:
            raise InputError(f"{named.said}: {robot} does not run at that time; see --restart")
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
