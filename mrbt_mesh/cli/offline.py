"""Commands that need no network: validate, plan, assign, new."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from mrbt_mesh.cli.common import (
    FAILURE,
    InputError,
    JsonOption,
    MissionArgument,
    console,
    fail,
    input_errors,
    print_json,
    read_mission,
)
from mrbt_mesh.cli.plan_view import render_plan
from mrbt_mesh.core.assignment import UNASSIGNED, AssignmentProblem, Bounds
from mrbt_mesh.core.canonical import solve
from mrbt_mesh.core.mission import MAX_PERFORMANCE, MICRO
from mrbt_mesh.core.solvers import DEFAULT_SOLVER, SOLVERS
from mrbt_mesh.formats.facts_file import plan_from_file
from mrbt_mesh.formats.mission_file import compile_mission, mission_warnings
from mrbt_mesh.formats.template import FolderInUseError, write_template

MAX_PROBLEM_BYTES = 256 << 20


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
    as_json: JsonOption = False,
) -> None:
    """Plan for given facts and explain the plan. No network.

    Example: mrbt plan examples/vehicle_repair/mission.yaml --alive A1,B1,C1
    """
    loaded = read_mission(mission)
    with input_errors():
        result = plan_from_file(loaded, facts, _names(alive))
    if as_json:
        data = result.to_json() | {"digest": result.digest.hex()}
        data["statuses"] = {
            f"{node.index}:{loaded.tree.path(node.index)}": status.name.lower()
            for node, status in zip(loaded.tree.nodes, result.evaluation.statuses, strict=True)
        }
        print_json(data)
    else:
        console.print(render_plan(loaded, result))


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [n.strip() for n in text.split(",") if n.strip()]


def new(
    folder: Annotated[Path, typer.Argument(help="A folder that does not exist yet.")],
) -> None:
    """Write a small mission and a robot of your own that run at once.

    Example: mrbt new my_team && mrbt up my_team/mission.yaml
    """
    try:
        written = write_template(folder)
    except (FolderInUseError, OSError) as error:
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
    as_json: JsonOption = False,
) -> None:
    """Solve one assignment problem, exactly and canonically. Exit status 1 if infeasible.

    Example: mrbt assign problem.json --json, where problem.json holds
    {"robots": {"r1": {"taskA": 3.0}}, "demands": [{"id": "d1", "local_task": "taskA",
    "min": 1, "max": 2}]}
    """
    with input_errors():
        parsed, demands = _read_problem(problem)
    choice = solve(parsed, SOLVERS[DEFAULT_SOLVER])
    if choice is None:
        short = _short(parsed)
        if as_json:
            print_json({"feasible": False, "short": [demands[i] for i in short]})
        else:
            listed = ", ".join(demands[i] for i in short)
            console.print(f"[bold red]infeasible[/]: short of robots: {listed}", highlight=False)
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
        if SOLVERS[DEFAULT_SOLVER](trial) is None:
            short.append(index)
        else:
            kept.append(index)
    return short


def _read_problem(path: Path) -> tuple[AssignmentProblem, list[str]]:
    try:
        if path.stat().st_size > MAX_PROBLEM_BYTES:
            raise InputError(f"{path} is larger than {MAX_PROBLEM_BYTES >> 20} MiB")
        data = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not JSON: {error}") from error
    if not isinstance(data, dict) or not isinstance(data.get("robots"), dict):
        raise InputError(f'{path}: expected {{"robots": {{...}}, "demands": [...]}}')
    if not isinstance(data.get("demands"), list):
        raise InputError(f"{path}: demands: a list is expected")
    demands = [_demand(path, i, row) for i, row in enumerate(data["demands"])]
    ids = [bounds.id for bounds, _ in demands]
    for name, count in Counter(ids).items():
        if count > 1:
            raise InputError(f"{path}: demand {name!r} appears {count} times")
    by_task: dict[str, list[int]] = {}
    for index, (_, local_task) in enumerate(demands):
        by_task.setdefault(local_task, []).append(index)
    robots = tuple(sorted(data["robots"]))
    performance = tuple(_performance(path, r, data["robots"][r], by_task) for r in robots)
    return AssignmentProblem.of(robots, (b for b, _ in demands), performance), ids


def _demand(path: Path, index: int, row: Any) -> tuple[Bounds, str]:
    where = f"{path}: demands[{index}]"
    if not isinstance(row, dict) or not {"id", "local_task", "min", "max"} <= set(row):
        raise InputError(f"{where}: id, local_task, min and max are expected")
    if not isinstance(row["id"], str) or not isinstance(row["local_task"], str):
        raise InputError(f"{where}: id and local_task are texts")
    low, high = row["min"], row["max"]
    if any(not isinstance(n, int) or isinstance(n, bool) for n in (low, high)):
        raise InputError(f"{where}: min and max are whole numbers")
    if not 0 <= low <= high:
        raise InputError(f"{where}: 0 <= min <= max is expected, found min {low}, max {high}")
    return Bounds(row["id"], low, high), row["local_task"]


def _performance(
    path: Path, robot: str, table: Any, by_task: Mapping[str, list[int]]
) -> dict[int, int]:
    if not isinstance(table, dict):
        raise InputError(f"{path}: robots.{robot}: a map of local task to performance is expected")
    result = {}
    for local_task, value in table.items():
        where = f"{path}: robots.{robot}.{local_task}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{where}: a number is expected; leave out what it cannot do")
        try:
            micro = int((Decimal(str(value)) * MICRO).to_integral_value())
        except (InvalidOperation, ValueError, OverflowError):
            raise InputError(f"{where}: {value} is no finite number") from None
        if abs(micro) > MAX_PERFORMANCE:
            raise InputError(f"{where}: {value} is out of range (at most 1e6 either way)")
        for index in by_task.get(local_task, ()):
            result[index] = micro
    return result
