"""The settings of which `mrbt estimate` makes runs; options of no effect are refused."""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.cli.framework.declare import Given
from mrbt_mesh.cli.framework.terminal import note
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.sim.estimate import Point
from mrbt_mesh.sim.statistics.sweeps import (
    FAILURE_RATE,
    FAULT_RATE,
    MAJOR,
    MINOR,
    MINOR_RATE,
    ROBOTS,
    parse_sweep,
    points_of,
)
from mrbt_mesh.sim.statistics.team_sizes import resized
from mrbt_mesh.sim.world.failures import EVERYBODY, FailureModel


def points(
    mission: Mission, base: FailureModel, robots: int | None, sweeps: Sequence[str], given: Given
) -> tuple[Point, ...]:
    """The settings of which runs are made: one, or those of up to two sweeps.

    Raises InputError for wrong sweeps, and for options that would be of no effect.
    """
    swept = dict(parse_sweep(text) for text in sweeps)
    found = points_of(mission, base, robots, sweeps)
    _refuse_swept(base, swept, given)
    _refuse_idle(found, given)
    _refuse_nobody(mission, base, found)
    wanted = 1
    for values in swept.values():
        wanted *= len(values)
    if len(found) < wanted:
        less = wanted - len(found)
        note(f"left out: {less} of {wanted} settings, of more faults than the team can suffer")
    return found


def _refuse_swept(base: FailureModel, swept: dict[str, list[str]], given: Given) -> None:
    """Refuse what a sweep replaces."""
    for name in (MAJOR, MINOR, ROBOTS):
        if name in swept:
            given.refuse([f"--{name}"], f"--sweep {name} gives its values")
    for name, of_whom in (
        (FAULT_RATE, base.major),
        (MINOR_RATE, base.minor),
        (FAILURE_RATE, base.actions),
    ):
        if name in swept and EVERYBODY in of_whom:
            raise InputError(f"--{name} for everybody: --sweep {name} gives its values")


def _refuse_idle(found: Sequence[Point], given: Given) -> None:
    """Refuse options about faults that no run can have."""
    models = [point.failures for point in found]
    if not any(m.major_faults or m.minor_faults for m in models):
        given.refuse(["--within"], "for --major and --minor, of which there are none")
    if not any(m.major_faults or m.major for m in models):
        given.refuse(["--return-after"], "no robot dies: see --fault-rate and --major")
    if not any(m.minor_faults or m.minor for m in models):
        given.refuse(["--repair-after"], "no capability is lost: see --minor-rate and --minor")


def _refuse_nobody(mission: Mission, base: FailureModel, found: Sequence[Point]) -> None:
    """Refuse rates of robots and types that no team has: one of another size has other robots."""
    teams = [
        (mission if size is None else resized(mission, size)).robots
        for size in {point.robots for point in found}
    ]
    known = {name for team in teams for robot in team.values() for name in (robot.id, robot.type)}
    for option, of_whom in ((FAULT_RATE, base.major), (MINOR_RATE, base.minor)):
        for who in sorted({*of_whom} - known - {EVERYBODY}):
            listed = ", ".join(sorted(known))
            raise InputError(f"--{option} {who}: not in a team of that size ({listed})")
