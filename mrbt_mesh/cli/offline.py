"""Commands that need no network: validate, plan, assign, new."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from mrbt_mesh.cli.common import (
    FAILURE,
    JsonOption,
    MissionArgument,
    SolverOption,
    console,
    fail,
    input_errors,
    print_json,
    read_mission,
)
from mrbt_mesh.cli.plan_view import render_plan
from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.problem import UNASSIGNED, AssignmentProblem, Bounds
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.formats.assignment_file import problem_from_file
from mrbt_mesh.formats.facts_file import plan_from_file
from mrbt_mesh.formats.mission_file import compile_mission, mission_warnings
from mrbt_mesh.formats.shipped import UnknownExampleError, examples
from mrbt_mesh.formats.template import (
    FolderInUseError,
    example_files,
    template_files,
    write_files,
)
from mrbt_mesh.runtime.solver_loader import load_solver, solver_for


def validate(
    mission: MissionArgument,
    compile_to: Annotated[
        Path | None, typer.Option("--compile", help="Also write the compiled mission here.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check a mission file; say what it holds.

    Example: mrbt validate examples/vehicle_repair/mission.yaml
    """
    loaded = read_mission(mission)
    warnings = mission_warnings(loaded)
    if compile_to is not None:
        try:
            compile_to.write_text(compile_mission(loaded))
        except OSError as error:
            fail(f"cannot write {compile_to}: {error.strerror}")
    counts = {
        "robots": len(loaded.robots),
        "local_tasks": len(loaded.local_tasks),
        "global_tasks": len(loaded.global_tasks),
        "tree_nodes": len(loaded.tree.nodes),
    }
    if as_json:
        print_json(
            {"mission": loaded.name, "digest": loaded.digest, **counts, "warnings": warnings}
        )
        return
    listed = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items())
    console.print(f"[bold green]valid[/] {loaded.name}: {listed}")
    for warning in warnings:
        console.print(f"[yellow]warning:[/] {warning}", soft_wrap=True)


def plan(
    mission: MissionArgument,
    facts: Annotated[
        Path | None, typer.Option("--facts", help="YAML or JSON file of facts; see docs.")
    ] = None,
    alive: Annotated[
        str | None, typer.Option("--alive", help="Living robots, A1,B1. Default: all.")
    ] = None,
    solver: SolverOption = None,
    as_json: JsonOption = False,
) -> None:
    """Plan for given facts and explain the plan. No network.

    Example: mrbt plan examples/vehicle_repair/mission.yaml --alive A1,B1,C1
    """
    loaded = read_mission(mission)
    with input_errors():
        result = plan_from_file(loaded, facts, _names(alive), solver_for(loaded, solver))
    if as_json:
        data = result.to_json() | {"digest": result.digest.hex()}
        data["statuses"] = {
            f"{node.index}:{loaded.tree.path(node.index)}": result.evaluation.status_of(
                node.index
            ).name.lower()
            for node in loaded.tree.nodes
        }
        print_json(data)
    else:
        console.print(render_plan(loaded, result))


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [n.strip() for n in text.split(",") if n.strip()]


def new(
    folder: Annotated[Path, typer.Argument(help="A folder that does not exist yet.")],
    example: Annotated[
        str | None,
        typer.Option(
            "--example", metavar="NAME", help=f"Copy this example: {', '.join(examples())}."
        ),
    ] = None,
) -> None:
    """Write a small mission and a robot of your own that run at once; or copy an example.

    Example: mrbt new my_team && mrbt up my_team/mission.yaml
    """
    try:
        files = template_files() if example is None else example_files(example)
        written = write_files(folder, files)
    except (FolderInUseError, UnknownExampleError, OSError) as error:
        fail(str(error))
    for path in written:
        console.print(f"wrote {path}", highlight=False, soft_wrap=True)
    console.print(f"\nnow: [bold]mrbt up {folder / 'mission.yaml'}[/]", highlight=False)


def key(
    path: Annotated[Path, typer.Argument(help="A file that does not exist yet.", metavar="FILE")],
) -> None:
    """Make a key for a team on the transport wireless: who holds it may take part.

    Example: mrbt key team.pem, copy it to every robot, then there:
    mrbt agent --transport wireless --key team.pem --mission MISSION --robot A1
    """
    # For this command alone: the library is large.
    from mrbt_mesh.runtime.team_key import write_team_key

    try:
        write_team_key(path)
    except FileExistsError:
        fail(f"{path} exists already: choose another name, or remove it first")
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror}")
    console.print(f"wrote {path}; keep it as secret as a password", highlight=False, soft_wrap=True)


def assign(
    problem: Annotated[Path, typer.Argument(help="Problem file (.json).", metavar="PROBLEM")],
    solver: SolverOption = None,
    as_json: JsonOption = False,
) -> None:
    """Solve one assignment problem, exactly and canonically. Exit status 1 if infeasible.

    Example: mrbt assign problem.json --json, where problem.json holds
    {"robots": {"r1": {"taskA": 3.0}}, "demands": [{"id": "d1", "local_task": "taskA",
    "min": 1, "max": 2}]}; "constraints" may limit who works together (docs/solvers.md)
    """
    with input_errors():
        parsed = problem_from_file(problem)
        choice = solve(parsed, load_solver(solver, bool(parsed.constraints)))
    demands = [bounds.id for bounds in parsed.demands]
    if choice is None:
        short = _short(parsed)
        if as_json:
            print_json({"feasible": False, "short": [demands[i] for i in short]})
        else:
            listed = ", ".join(demands[i] for i in short)
            limits = " within the constraints" if parsed.constraints else ""
            console.print(
                f"[bold red]infeasible[/]: short of robots{limits}: {listed}", highlight=False
            )
        raise typer.Exit(FAILURE)
    assignment = {
        robot: None if index == UNASSIGNED else demands[index]
        for robot, index in zip(parsed.robots, choice, strict=True)
    }
    objective = parsed.objective(choice) / MICRO
    if as_json:
        print_json({"feasible": True, "objective": objective, "assignment": assignment})
        return
    table = Table("robot", "demand", title=f"objective {objective:g}")
    for robot, demand in assignment.items():
        table.add_row(robot, demand or "[dim]unassigned[/]")
    console.print(table)


def _short(problem: AssignmentProblem) -> list[int]:
    """Demands that lack robots: in order, each that cannot be met beside those before it."""
    kept: list[int] = []
    short = []
    for index in range(len(problem.demands)):
        bounds = tuple(
            b if i in kept or i == index else Bounds(b.id, 0, b.upper)
            for i, b in enumerate(problem.demands)
        )
        trial = replace(problem, demands=bounds)
        if default_solver(trial) is None:
            short.append(index)
        else:
            kept.append(index)
    return short
