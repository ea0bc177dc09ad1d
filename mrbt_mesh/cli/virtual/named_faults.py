"""Faults as options of `mrbt sim run`: ROBOT[:LOCAL_TASK[=X]]@SECONDS."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO, Mission, micro_performance
from mrbt_mesh.core.mission.names import ALL
from mrbt_mesh.errors import InputError
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.named_faults import (
    NamedFault,
    check_local_task,
    check_robot,
)

_WHEN = re.compile(r"(?P<what>[^@]+)@(?P<at_s>\d+(?:\.\d+)?)", re.ASCII)
# Later than any run lasts.
NEVER_S = 1e12
# A comma between two faults, but not between the arguments of a local task.
_COMMA = re.compile(r",(?![^(]*\))")
_OF_A_ROBOT: dict[str, Callable[[str], faults.RobotFault]] = {
    "--kill": faults.Kill,
    "--restart": faults.Restart,
    "--freeze": faults.Freeze,
    "--thaw": faults.Thaw,
    "--leave": faults.Leave,
}


def read_faults(
    mission: Mission, texts: Mapping[str, Sequence[str]], at_s: float | None = None
) -> list[NamedFault]:
    """Return the faults of all options, by time.

    `texts` maps options to their values; `at_s` is the default time. Raises InputError for a text
    that is not a fault of this mission's robots.
    """
    when = "" if at_s is None else f"@{at_s:.6f}"
    found = [
        _fault(mission, option, (part.strip() or text) + ("" if "@" in part else when))
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
    check_robot(mission, robot, said)
    if option in _OF_A_ROBOT:
        if colon:
            raise InputError(f"{said}: only --fault, --restore, --performance name a local task")
        return NamedFault(at_us, _OF_A_ROBOT[option](robot), said)
    if option == "--performance":
        return NamedFault(at_us, _performance(mission, robot, local_task, said), said)
    if not local_task and (colon or option == "--fault"):
        raise InputError(f"{said}: which local task? e.g. {robot}:all@4")
    check_local_task(mission, robot, local_task or ALL, said)
    make = faults.Lose if option == "--fault" else faults.Restore
    return NamedFault(at_us, make(robot, local_task or ALL), said)


def _performance(mission: Mission, robot: str, text: str, said: str) -> faults.ChangePerformance:
    local_task, equals, number = text.rpartition("=")
    if not equals or local_task in ("", ALL):
        raise InputError(f"{said}: of which local task? e.g. {robot}:LOCAL_TASK=0.5@4")
    try:
        value = micro_performance(float(number))
    except ValueError:
        problem = f"a performance from 0 to {MAX_PERFORMANCE // MICRO} expected"
        raise InputError(f"{said}: {problem}, found {number!r}") from None
    check_local_task(mission, robot, local_task, said)
    return faults.ChangePerformance(robot, local_task, value)
