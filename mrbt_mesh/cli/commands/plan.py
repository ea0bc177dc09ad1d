"""`mrbt validate` and `mrbt plan`: a mission, and its team's plan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrbt_mesh.cli.command import PATH, MrbtCommand
from mrbt_mesh.cli.options import (
    chosen_robots,
    fitting_program,
    json_option,
    mission_argument,
    program_option,
    robots_option,
    solver_option,
)

if TYPE_CHECKING:
    from mrbt_mesh.core.facts.team_facts import TeamFacts
    from mrbt_mesh.core.planning.plan import Plan
    from mrbt_mesh.core.planning.schedules import Lookahead

# The author of a schedule that this command searched.
SEARCHED = "this command (no robot searches)"


@click.command(cls=MrbtCommand)
@click.argument(
    "mission",
    metavar="[MISSION]",
    type=PATH,
    default="mission.yaml",
    help="Mission file. Default: mission.yaml.",
)
@click.option(
    "--compile", "compile_to", type=PATH, metavar="FILE", help="Also write the compiled mission."
)
@program_option
@robots_option
@json_option
def validate(
    mission: Path, compile_to: Path | None, program: str | None, robots: str | None, as_json: bool
) -> None:
    """Check a mission file and its robots' program.

    The program is imported, and must have a function for each local task of the robots.

    Example: mrbt validate examples/vehicle_repair/mission.yaml
    """
    from mrbt_mesh.cli.terminal import (
        check_outputs,
        console,
        labelled,
        print_done,
        print_json,
        write_file,
    )
    from mrbt_mesh.errors import FileError, InputError
    from mrbt_mesh.formats.cautions import cautions
    from mrbt_mesh.formats.mission_file import compile_mission, load_mission, mission_warnings
    from mrbt_mesh.formats.unused import unused_declarations
    from mrbt_mesh.runtime.program import functions_of
    from mrbt_mesh.runtime.solver_loader import solver_for

    check_outputs(mission, {"--compile": compile_to})
    loaded = load_mission(mission)
    solver_for(loaded, None)
    team = chosen_robots("--robots", robots, loaded)
    warnings = [*mission_warnings(loaded), *cautions(loaded)]
    reference = program or loaded.program
    warnings += unused_declarations(mission, reference)
    if reference is not None:
        code = fitting_program(loaded, team, reference)
        try:
            functions_of(code).check_computer()
        except FileError:
            raise
        except InputError as error:
            # Missions are also checked where no robot runs.
            warnings.append(f"no robot can start on this computer: {error}")
    if compile_to is not None:
        write_file(compile_to, compile_mission(loaded))
    counts = {
        "robots": len(loaded.robots),
        "local_tasks": len(loaded.local_tasks),
        "global_tasks": len([*loaded.all_tasks()]),
        "tree_nodes": len(loaded.tree.nodes),
    }
    if loaded.jobs:
        counts["job_types"] = len(loaded.jobs)
    if loaded.travel is not None:
        counts["places"] = len(loaded.travel.places)
    if as_json:
        names = {"mission": loaded.name, "digest": loaded.digest, "program": reference}
        print_json({**names, **counts, "warnings": warnings})
        return
    names_of = {name: name.replace("_", " ") for name in counts}
    listed = ", ".join(
        f"{count} {names_of[name].removesuffix('s') if count == 1 else names_of[name]}"
        for name, count in counts.items()
    )
    listed += ", no program named" if reference is None else ""
    print_done("valid", f"{loaded.name}: {listed}")
    for warning in warnings:
        console.print(labelled("warning", "yellow", warning), soft_wrap=True)


@click.command(cls=MrbtCommand)
@mission_argument
@click.option(
    "--facts", type=PATH, metavar="FILE", help="Facts (.yaml, .json). Default: at the start."
)
@click.option("--alive", metavar="A1,B1,...", help="Living robots. Default: all.")
@solver_option
@json_option
def plan(
    mission: Path, facts: Path | None, alive: str | None, solver: str | None, as_json: bool
) -> None:
    """Make the plan for given facts and explain it, with the assignment problem that it solves.

    For robots that travel it searches a schedule, as a robot would.

    Example: mrbt plan examples/vehicle_repair/mission.yaml --alive A1,B1,C1
    """
    from mrbt_mesh.cli.terminal import console, print_json
    from mrbt_mesh.cli.views.plan_view import render_plan
    from mrbt_mesh.core.planning.make_plan import make_plan
    from mrbt_mesh.formats.facts_file import ALIVE, facts_from_file
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.observer.idle import why_idle
    from mrbt_mesh.runtime.solver_loader import solver_for

    loaded = load_mission(mission)
    living = dict.fromkeys(chosen_robots("--alive", alive, loaded), ALIVE)
    team_facts = facts_from_file(loaded, facts)
    found = make_plan(team_facts, living, solver_for(loaded, solver))
    if found.ahead is not None and len(found.ahead.opens) > 1:
        _propose(team_facts, found.ahead)
        found = make_plan(team_facts, living, solver_for(loaded, solver))
    problem = _problem(found, team_facts, [*living]) | {"forecast": _forecast(found, team_facts)}
    idle = why_idle(found, team_facts, living)
    if not as_json:
        console.print(render_plan(loaded, found, problem, idle))
        return
    statuses = {
        f"{node.index}:{loaded.tree.path(node.index)}": found.evaluation.status_of(node.index)
        for node in loaded.tree.nodes
    }
    print_json(
        {
            **found.to_json(),
            "idle": idle,
            "waiting": [
                {
                    "activation": each.activation,
                    "global_task": each.global_task,
                    "blocked": each.is_blocked,
                    "reason": each.reason,
                }
                for each in found.waiting
            ],
            "digest": found.digest.hex(),
            **problem,
            "statuses": {place: status.name.lower() for place, status in statuses.items()},
        }
    )


def _forecast(found: Plan, facts: TeamFacts) -> dict[str, Any] | None:
    from mrbt_mesh.observer.forecast import forecast

    if found.ahead is None:
        return None
    ahead = replace(found.ahead, author=SEARCHED) if found.ahead.author else found.ahead
    return forecast(facts, ahead).to_json()


def _propose(facts: TeamFacts, ahead: Lookahead) -> None:
    """Search a schedule as a robot does, and add it to the facts as that of the first robot."""
    from mrbt_mesh.core.agent.scheduler import evaluations_of
    from mrbt_mesh.core.facts import records
    from mrbt_mesh.core.facts.store import Version, parse_entry
    from mrbt_mesh.core.scheduling.search import search
    from mrbt_mesh.formats.facts_file import ALIVE

    best = search(ahead.problem, evaluations_of(ahead.problem), 0)
    proposal = ahead.proposal(best.schedule).to_value()
    facts.map.merge([parse_entry(ahead.robots[0], records.SCHEDULE, Version(ALIVE, 1), proposal)])


def _problem(found: Plan, facts: TeamFacts, robots: list[str]) -> dict[str, Any]:
    """Return the assignment problem (2): a_j, b_j, p(i, l) of each demand, and the objective."""
    from mrbt_mesh.core.facts.team_facts import capability
    from mrbt_mesh.core.mission.mission import MICRO

    demands = []
    for bounds in found.bounds:
        values = {
            robot: capability(facts.members[robot].member, bounds.local_task)
            for robot in robots
            if robot in facts.members
        }
        performances = {robot: p / MICRO for robot, p in values.items() if p is not None}
        demands.append(bounds.to_json() | {"performances": performances})
    objective = sum(line.performance for line in found.assignments.values()) / MICRO
    return {"bounds": demands, "objective": objective}
