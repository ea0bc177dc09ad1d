"""`mrbt analyze`: the fault tolerance of a mission."""

from __future__ import annotations

from pathlib import Path

import click

from mrbt_mesh.cli.command import PATH, FiniteNumber, MrbtCommand
from mrbt_mesh.cli.options import json_option, mission_argument


@click.command(cls=MrbtCommand)
@mission_argument
@click.option("--costs", type=PATH, metavar="FILE", help="Costs for the advice (.yaml).")
@click.option(
    "--limit",
    type=FiniteNumber(0.1),
    default=5.0,
    metavar="SECONDS",
    help="Time for each question to the solver.",
)
@json_option
def analyze(mission: Path, costs: Path | None, limit: float, as_json: bool) -> None:
    """Find the faults that a mission survives.

    With advice on robots and capabilities to add. Of a mission with jobs, the faults with which a
    job of each type can still be done.

    Example: mrbt analyze examples/vehicle_repair/mission.yaml
    """
    from mrbt_mesh.core.assignment.problem import require_planner

    require_planner("mrbt analyze")
    from mrbt_mesh.analysis.tolerance.analyse import analyse
    from mrbt_mesh.analysis.tolerance.jobs import analyse_jobs
    from mrbt_mesh.analysis.tolerance.render import render_analysis, render_jobs
    from mrbt_mesh.analysis.tolerance.requirement import TooLargeError
    from mrbt_mesh.cli.terminal import bar_of_steps, console, print_json
    from mrbt_mesh.errors import InputError
    from mrbt_mesh.formats.costs_file import costs_from_file
    from mrbt_mesh.formats.mission_file import load_mission

    loaded = load_mission(mission)
    prices = loaded.costs if costs is None else costs_from_file(costs, loaded)
    try:
        with bar_of_steps("reading the mission") as update:
            if loaded.jobs:
                of_jobs = analyse_jobs(loaded, prices, limit, update)
            else:
                found = analyse(loaded, prices, limit, update)
    except TooLargeError as error:
        raise InputError(f"{mission}: {error}") from None
    if loaded.jobs and as_json:
        jobs = {each.type: each.to_json() for each in of_jobs}
        print_json({"mission": loaded.name, "jobs": jobs})
    elif loaded.jobs:
        console.print(render_jobs(loaded.name, of_jobs))
    elif as_json:
        print_json(found.to_json())
    else:
        console.print(render_analysis(found))
