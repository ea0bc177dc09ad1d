"""`mrbt plan`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import JsonOption, MissionArgument, SolverOption

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.core.planning.plan import Plan


def plan(
    mission: MissionArgument,
    facts: Annotated[
        Path | None,
        option("Facts (.yaml, .json): docs/facts.md. Default: at the start.", "FILE"),
    ] = None,
    alive: Annotated[str | None, option("Living robots. Default: all.", "A1,B1,...")] = None,
    solver: SolverOption = None,
    as_json: JsonOption = False,
) -> None:
    """Plan for given facts and explain the plan.

    Example: mrbt plan examples/vehicle_repair/mission.yaml --alive A1,B1,C1
    """
    from mrbt_mesh.cli.framework.terminal import console, print_json
    from mrbt_mesh.cli.missions import chosen_robots
    from mrbt_mesh.cli.views.plan_view import render_plan
    from mrbt_mesh.core.planning.make_plan import make_plan
    from mrbt_mesh.formats.facts_file import ALIVE, facts_from_file
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.solver_loader import solver_for

    loaded = load_mission(mission)
    living = dict.fromkeys(chosen_robots("--alive", alive, loaded), ALIVE)
    team_facts = facts_from_file(loaded, facts)
    found = make_plan(team_facts, living, solver_for(loaded, solver))
    if as_json:
        print_json(_as_data(loaded, found))
    else:
        console.print(render_plan(loaded, found))


def _as_data(mission: Mission, found: Plan) -> dict[str, Any]:
    statuses = {
        f"{node.index}:{mission.tree.path(node.index)}": found.evaluation.status_of(node.index)
        for node in mission.tree.nodes
    }
    return {
        **found.to_json(),
        "digest": found.digest.hex(),
        "bounds": [bounds.to_json() for bounds in found.bounds],
        "statuses": {place: status.name.lower() for place, status in statuses.items()},
    }
