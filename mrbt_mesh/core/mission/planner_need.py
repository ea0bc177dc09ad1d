"""Which missions cannot be planned without the extra `planner`: OR-tools and numpy.

That follows from the mission alone, and never from what a robot has installed: all robots of a
team plan by the same solvers, or do not join it.
"""

from __future__ import annotations

from mrbt_mesh.core.assignment.problem import PLANNER
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import MissingExtraError


def planner_need(mission: Mission, named: str | None = None) -> str:
    """What of the mission needs these libraries; empty if nothing does.

    `named`: the solver that takes the place of the mission's.
    """
    if mission.limits is not None:
        return f"with its {mission.limits.name}"
    if solver := named or mission.solver:
        return f"with the solver {solver!r}"
    if mission.may_need_arrays:
        robots, demands = len(mission.robots), mission.most_demands
        return f"with {robots} robots and up to {demands} local tasks at the same time"
    return ""


def planner_problem(mission: Mission, lacks_planner: bool, named: str | None = None) -> str:
    """Why a robot cannot plan the mission, with the remedy; empty if it can."""
    need = planner_need(mission, named) if lacks_planner else ""
    return str(MissingExtraError.of(f"mission {mission.name} {need}", PLANNER)) if need else ""
