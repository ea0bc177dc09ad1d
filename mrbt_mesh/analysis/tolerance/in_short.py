"""What a mission survives, in one line each: for `mrbt revise --dry-run`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from mrbt_mesh.core.assignment.problem import require_planner
from mrbt_mesh.core.mission.mission import Mission

if TYPE_CHECKING:
    from mrbt_mesh.analysis.tolerance.service import Fault


def survived_losses(mission: Mission) -> dict[str, str]:
    """Which single faults are survived, in words: by type of jobs, or under "" those of a mission
    without jobs. Of a type with several kinds of arguments: with each of them. Raises
    MissingExtraError.
    """
    require_planner("the analysis of a mission")
    from mrbt_mesh.analysis.tolerance.jobs import single_jobs
    from mrbt_mesh.analysis.tolerance.requirement import TooLargeError

    try:
        if not mission.jobs:
            return {"": _in_words([mission])}
        return {
            name: _in_words(one for _, one in single_jobs(mission, known))
            for name, known in sorted(mission.jobs.items())
        }
    except TooLargeError as error:
        return {"": f"not known: {error}"}


def _in_words(missions: Iterable[Mission]) -> str:
    from mrbt_mesh.analysis.tolerance.readings import serial
    from mrbt_mesh.analysis.tolerance.render import grouped, shortened
    from mrbt_mesh.analysis.tolerance.service import capability_faults, robot_faults

    fatal: list[dict[Fault, None]] = [{}, {}]
    for mission in missions:
        question = serial(mission)
        if not question.reading.is_feasible:
            return f"nothing: {question.obstacle}"
        for found, faults in zip(
            fatal, (robot_faults(mission), capability_faults(mission)), strict=True
        ):
            found.update(dict.fromkeys(question.reading.critical(faults)))
    robot, capability = (
        f"any one {kind}" + (f" (except {shortened(grouped(names))})" if names else "")
        for kind, names in zip(("robot", "capability"), fatal, strict=True)
    )
    return f"the loss of {robot} or of {capability}"
