"""`mrbt assign`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.cli.options import JsonOption

if TYPE_CHECKING:
    from mrbt_mesh.core.assignment.problem import AssignmentProblem


def assign(
    problem: Annotated[Path, argument("PROBLEM", "Problem file (.json).")],
    solver: Annotated[
        str | None,
        option(
            "min_cost_flow, cp_sat, brute_force, or your own: docs/solvers.md. "
            "Default: min_cost_flow, or cp_sat for constraints.",
            "NAME",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Solve one assignment problem, exactly and canonically.

    Exit status: 0 solved, 1 infeasible, 2 bad input.

    Example: mrbt assign problem.json --json, where problem.json holds
    {"robots": {"r1": {"taskA": 3.0}}, "demands": [{"id": "d1", "local_task": "taskA",
    "min": 1, "max": 2}]}; "constraints" may limit who works together (docs/solvers.md)
    """
    from rich.table import Table

    from mrbt_mesh.cli.framework.exits import FAILURE
    from mrbt_mesh.cli.framework.terminal import console, print_json
    from mrbt_mesh.core.assignment.canonical import solve
    from mrbt_mesh.core.assignment.problem import UNASSIGNED
    from mrbt_mesh.core.mission.mission import MICRO
    from mrbt_mesh.formats.assignment_file import problem_from_file
    from mrbt_mesh.runtime.solver_loader import load_solver

    parsed = problem_from_file(problem)
    choice = solve(parsed, load_solver(solver, bool(parsed.constraints)))
    demands = [bounds.id for bounds in parsed.demands]
    if choice is None:
        short = [demands[index] for index in _short(parsed)]
        if as_json:
            print_json({"feasible": False, "short": short})
        else:
            limits = " within the constraints" if parsed.constraints else ""
            text = f"[bold red]infeasible[/]: short of robots{limits}: {', '.join(short)}"
            console.print(text, highlight=False)
        raise SystemExit(FAILURE)
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
    from dataclasses import replace

    from mrbt_mesh.core.assignment.problem import Bounds
    from mrbt_mesh.core.assignment.solvers import default_solver

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
