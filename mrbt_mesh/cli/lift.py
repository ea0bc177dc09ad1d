"""`mrbt lift`: a team's mission from the tree that drives one robot."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from mrbt_mesh.analysis.lift import LiftDecision, Lifted
from mrbt_mesh.analysis.lift_mission import LiftedMission, heading, lift_mission
from mrbt_mesh.cli.common import (
    InputError,
    JsonOption,
    console,
    errors,
    fail,
    input_errors,
    print_json,
    read_tree_file,
)
from mrbt_mesh.formats.btcpp.library import Library
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_file import MissionError
from mrbt_mesh.formats.mission_writer import mission_text
from mrbt_mesh.formats.problems import Problem
from mrbt_mesh.formats.team_file import TeamFile, load_team


def lift(
    file: Annotated[
        Path, typer.Argument(help="A single robot's tree, BehaviorTree.CPP XML.", metavar="FILE")
    ],
    robots: Annotated[
        Path,
        typer.Option("--robots", help="Team file: robots, and what their local tasks do (YAML)."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Write the mission there; without it only explain."),
    ] = None,
    tree: Annotated[
        str | None, typer.Option("--tree", help="ID of the tree. Default: the main tree.")
    ] = None,
    assume_independent: Annotated[
        list[str] | None,
        typer.Option(
            "--assume-independent",
            help="Children of this node (path or name) do not depend on one another.",
            metavar="NODE",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make a team's mission out of the tree that drives one robot, and explain it.

    Every action becomes a global task for one robot (paper, section V-A). What may happen at the
    same time follows from what the actions declare to read, change and need; with no declarations
    nothing is put in parallel.

    Example: mrbt lift examples/lift/repair.xml --robots examples/lift/team.yaml -o mission.yaml
    """
    with input_errors():
        library, name = _library(file, tree)
        team = load_team(robots)
        found = lift_mission(library, name, team, assume_independent or [], _name(file))
        text = _checked_text(found, name, file, robots, output)
    if output is not None:
        try:
            output.write_text(text, encoding="utf-8")
        except OSError as error:
            fail(f"cannot write {output}: {error.strerror}")
    for note in found.notes:
        errors.print(f"note: {note}", soft_wrap=True, markup=False)
    if as_json:
        print_json(_as_data(found, output))
    else:
        _explain(found.lifted, team, output)


def _library(file: Path, tree: str | None) -> tuple[Library, str]:
    """The checked file and the ID of the tree to lift."""
    library, findings = read_tree_file(file)
    findings.raise_errors()
    name = tree or library.main_tree
    if name is None or name not in library.trees:
        known = ", ".join(library.trees) or "none"
        what = f"there is no tree {tree!r}" if tree else "no tree is named as the main one"
        raise InputError(f"{file}: {what}; choose with --tree (there are: {known})")
    return library, name


def _name(file: Path) -> str:
    name = "".join(c if c.isalnum() or c == "_" else "_" for c in file.stem)
    return name if name[:1].isalpha() else f"mission_{name}"


def _checked_text(
    found: LiftedMission, tree: str, file: Path, robots: Path, output: Path | None
) -> str:
    """The mission file's text, with `program` relative to where it is written."""
    data = dict(found.data)
    target = output.resolve().parent if output is not None else robots.resolve().parent
    program = data.get("program")
    if program is not None:
        path, colon, rest = str(program).partition(".py")
        absolute = (robots.resolve().parent / f"{path}.py").resolve()
        data["program"] = f"{os.path.relpath(absolute, target)}{rest}" if colon else program
    text = mission_text(data, heading(tree, file, robots, found.lifted))
    try:
        mission_from_yaml(text, str(output or "the mission"), target)
    except MissionError as error:
        first = Problem(
            str(robots), 0, "", "does not fit the tree; the mission would have these problems"
        )
        raise MissionError([first, *error.problems]) from None
    return text


# -- what is told -------------------------------------------------------------------------------


def _as_data(found: LiftedMission, output: Path | None) -> dict[str, Any]:
    lifted = found.lifted
    return {
        "mission": str(output) if output is not None else None,
        "serial_s": lifted.serial_us / 1e6,
        "critical_path_s": lifted.critical_us / 1e6,
        "factor": round(lifted.factor, 3),
        "decisions": [_decision_data(decision) for decision in lifted.decisions],
        "notes": [str(note) for note in found.notes],
    }


def _decision_data(decision: LiftDecision) -> dict[str, Any]:
    return {
        "path": decision.path,
        "kind": decision.kind,
        "children": list(decision.before),
        "arrangement": decision.after,
        "parallel": decision.is_parallel,
        "dependences": [
            {"first": d.first, "second": d.second, "reason": d.reason, "added": d.is_added}
            for d in decision.dependences
        ],
        "notes": list(decision.notes),
    }


def _explain(lifted: Lifted, team: TeamFile, output: Path | None) -> None:
    for decision in lifted.decisions:
        mark = ("∥", "bold green") if decision.is_parallel else ("→", "dim")
        console.print(
            Text.assemble(mark, " ", (decision.path, "bold"), (f"  {decision.kind}", "dim"))
        )
        console.print(Text(f"    {decision.after}", "green" if decision.is_parallel else ""))
        for dependence in decision.dependences:
            style = "yellow" if dependence.is_added else "dim"
            pair = f"{dependence.first} before {dependence.second}: {dependence.reason}"
            console.print(Text(f"      {pair}", style), soft_wrap=True)
        for note in decision.notes:
            console.print(Text(f"      {note}", "yellow"), soft_wrap=True)
    serial_s, critical_s = lifted.serial_us / 1e6, lifted.critical_us / 1e6
    console.print()
    console.print(
        f"One robot works {serial_s:g} s; the longest chain is {critical_s:g} s: "
        f"at most [bold]{lifted.factor:.2f}[/] times faster.",
        highlight=False,
    )
    if output is not None:
        robots = len(team.model.robots)
        console.print(
            f"written: {output} ({robots} robots); run it with: mrbt up {output}",
            highlight=False,
            soft_wrap=True,
        )
