"""The files that `mrbt tree lift` reads, and the mission that it writes."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click

from mrbt_mesh.analysis.lift.in_units import LiftedUnits, UnitsByHand, lift_units
from mrbt_mesh.analysis.lift.mission import LiftedMission, heading, lift_mission
from mrbt_mesh.analysis.lift.render import lifted_data, render_lifted, render_units, units_data
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.document import SUBTREE, Document, read_document
from mrbt_mesh.btcpp.files.folder import read_folder
from mrbt_mesh.btcpp.files.library import Library, together
from mrbt_mesh.btcpp.files.nav2_nodes import know_nav2
from mrbt_mesh.cli.terminal import console, note, print_json, write_file
from mrbt_mesh.errors import FileError, InputError, Problem
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_writer import mission_text
from mrbt_mesh.formats.shipped import mission_name
from mrbt_mesh.formats.team_file import TeamFile, load_team
from mrbt_mesh.formats.units_file import load_units


@dataclass(frozen=True)
class LiftRequest:
    """The options of `mrbt tree lift`."""

    file: Path
    robots: Path
    output: Path | None
    tree: str | None
    models: Sequence[Path]
    folders: Sequence[Path]
    independent: Sequence[str]
    units: str | None
    actions: Sequence[str] = ()


@dataclass(frozen=True)
class LiftedFiles:
    """The mission, in units if that was asked for, and the files to write with their texts."""

    mission: LiftedMission
    units: LiftedUnits | None
    robots: int
    files: Mapping[Path, str]


def lift_files(request: LiftRequest) -> LiftedFiles:
    """Read, lift and check. Raises InputError and FileError."""
    others = known_besides(request.models, request.folders)
    library, tree = library_and_tree(request.file, request.tree, others, request.actions)
    return lift_tree(library, tree, load_team(request.robots), request)


def print_lifted(done: LiftedFiles, output: Path | None, as_json: bool) -> None:
    """Write the files, and print the decisions with their reasons."""
    for path, text in done.files.items():
        write_file(path, text)
    for remark in done.mission.notes:
        note(str(remark))
    if as_json:
        data = lifted_data(done.mission, output)
        print_json(data | (units_data(done.units) if done.units else {}))
        return
    if done.units is not None:
        console.print(render_units(done.units), soft_wrap=True)
    console.print(render_lifted(done.mission.lifted), soft_wrap=True)
    if output is not None:
        written = " and ".join(map(str, done.files))
        click.echo(f"written: {written} ({done.robots} robots); run it with: mrbt up {output}")


def lift_tree(library: Library, tree: str, team: TeamFile, request: LiftRequest) -> LiftedFiles:
    """Lift a tree for a team, both of which have been read. Raises InputError and FileError."""
    file, output = request.file, request.output
    name, independent = mission_name(file.stem), request.independent
    if request.units is None:
        mission = lift_mission(library, tree, team, independent, name)
        units, document = None, None
    else:
        by_hand = units_by_hand(request.units)
        beside = units_file(file, output)
        units = lift_units(library, tree, team, independent, name, by_hand, beside.name)
        mission, document = units.mission, units.document
    text = checked_text(mission, tree, file, request.robots, output, document)
    files = {}
    if output is not None:
        files[output] = text
        if document is not None:
            files[units_file(file, output)] = document.text()
    return LiftedFiles(mission, units, len(team.model.robots), files)


def known_besides(models: Sequence[Path], folders: Sequence[Path]) -> Library:
    """The trees and models of other files, and of all files of folders; raises InputError."""
    documents = [read_document(path) for path in models]
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"--trees {folder}: there is no such folder")
        documents += read_folder(folder).documents.values()
    return together(documents)


def library_and_tree(
    file: Path, tree: str | None, others: Library, actions: Sequence[str] = ()
) -> tuple[Library, str]:
    """The checked file and the ID of the tree to lift; raises InputError.

    It is the main tree, or where BehaviorTree.CPP asks for a name, the only one that no other tree
    of the file uses. `actions`: SubTrees that are actions of the program instead. Nav2's nodes need
    no models.
    """
    library, findings = check_file(file, others=others)
    findings.raise_errors()
    try:
        library.make_actions(actions)
    except ValueError as error:
        raise InputError(f"--as-action: {error}") from None
    know_nav2(library)
    own = library.own_trees
    elements = [element for source in own.values() for element in source.element.walk()]
    used = {element.get("ID") for element in elements if element.tag == SUBTREE}
    outermost = [name for name in own if name not in used]
    name = tree or library.main_tree or (outermost[0] if len(outermost) == 1 else None)
    if name is None or name not in library.trees:
        known = ", ".join(own) or "none"
        what = f"there is no tree {tree!r}" if tree else "no tree is named as the main one"
        raise InputError(f"{file}: {what}; choose with --tree (there are: {known})")
    return library, name


def units_by_hand(units: str) -> UnitsByHand | None:
    """The file that `--units` names, None for `auto`. Raises FileError and InputError."""
    if units == "auto":
        return None
    if Path(units).suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"--units {units}: is neither auto nor a file that ends in .yaml or .yml")
    return UnitsByHand(units, load_units(Path(units)))


def units_file(file: Path, output: Path | None) -> Path:
    """Where the trees of units are written: beside the mission."""
    beside = output if output is not None else file
    return beside.with_name(f"{beside.stem}_units.xml")


def checked_text(
    found: LiftedMission,
    tree: str,
    file: Path,
    robots: Path,
    output: Path | None,
    units: Document | None = None,
) -> str:
    """The mission file's text, with `program` relative to where it is written.

    `units` are the trees that will be beside it. Raises FileError if the team file does not fit
    the tree.
    """
    data = dict(found.data)
    target = output.resolve().parent if output is not None else robots.resolve().parent
    program = data.get("program")
    if program is not None:
        path, colon, rest = str(program).partition(".py")
        absolute = (robots.resolve().parent / f"{path}.py").resolve()
        data["program"] = f"{os.path.relpath(absolute, target)}{rest}" if colon else program
    text = mission_text(data, heading(tree, file, robots, found.lifted))
    try:
        with tempfile.TemporaryDirectory() as folder:
            if units is not None:
                (Path(folder) / units.file).write_text(units.text(), encoding="utf-8")
            mission_from_yaml(text, str(output or "the mission"), Path(folder))
    except FileError as error:
        first = Problem(
            str(robots), 0, "", "does not fit the tree; the mission would have these problems"
        )
        here = [replace(p, message=p.message.replace(f"{folder}/", "")) for p in error.problems]
        raise FileError([first, *here]) from None
    return text
