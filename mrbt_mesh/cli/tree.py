"""Commands on trees: BehaviorTree.CPP files and the trees of missions."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from mrbt_mesh.cli.common import (
    BAD_INPUT,
    InputError,
    JsonOption,
    console,
    errors,
    fail,
    input_errors,
    print_json,
    read_mission,
    read_tree_file,
)
from mrbt_mesh.cli.tree_drawing import render_dot, render_mermaid, render_text
from mrbt_mesh.cli.tree_shapes import Shape, file_shapes, mission_shapes
from mrbt_mesh.cli.tree_svg import render_svg
from mrbt_mesh.formats.btcpp.document import Category, Document
from mrbt_mesh.formats.btcpp.export import compact, explicit, team_tree_document, with_ids
from mrbt_mesh.formats.btcpp.findings import Finding, Findings, Severity
from mrbt_mesh.formats.btcpp.library import Library
from mrbt_mesh.formats.btcpp.team_tree import to_team_tree
from mrbt_mesh.formats.btcpp.xml_reader import TreeFileError
from mrbt_mesh.formats.mission_file import mission_warnings
from mrbt_mesh.formats.problems import Problem

MISSION_SUFFIXES = (".yaml", ".yml", ".json")

tree_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="Show, check and convert trees: BehaviorTree.CPP files and missions.",
    epilog="Example: mrbt tree show examples/vehicle_repair/mission.yaml",
)

FileArgument = Annotated[
    Path, typer.Argument(help="BehaviorTree.CPP file (.xml) or mission (.yaml).", metavar="FILE")
]
OutputOption = Annotated[
    Path | None, typer.Option("--output", "-o", help="Write there instead of to the terminal.")
]


def _is_mission(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix not in (".xml", *MISSION_SUFFIXES):
        raise InputError(f"{path}: a tree is in a file that ends in .xml, .yaml, .yml or .json")
    return suffix != ".xml"


def _write(text: str, path: Path | None) -> None:
    if path is None:
        sys.stdout.write(text)
        return
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror}")


def _print_finding(finding: Finding, target: Console) -> None:
    style = "bold red" if finding.severity is Severity.ERROR else "yellow"
    _print_line(target, f"{finding.severity}:", style, str(finding))


def _print_line(target: Console, first: str, style: str, rest: str) -> None:
    """One line that is not wrapped, and in which brackets of names mean nothing."""
    target.print(Text.assemble((first, style), f" {rest}"), soft_wrap=True, highlight=False)


@tree_app.command()
def show(
    file: FileArgument,
    svg: Annotated[bool, typer.Option("--svg", help="As a picture (SVG).")] = False,
    dot: Annotated[bool, typer.Option("--dot", help="For Graphviz.")] = False,
    mermaid: Annotated[bool, typer.Option("--mermaid", help="For Markdown.")] = False,
    only: Annotated[
        str | None, typer.Option("--only", help="Only the tree of this ID.", metavar="ID")
    ] = None,
    output: OutputOption = None,
) -> None:
    """Draw the trees of a file.

    Example: mrbt tree show navigate.xml --svg -o navigate.svg
    """
    with input_errors():
        if svg + dot + mermaid > 1:
            raise InputError("give one of --svg, --dot and --mermaid")
        shapes = _shapes(file)
        if only is not None:
            known = ", ".join(shape.label for shape in shapes)
            shapes = [shape for shape in shapes if shape.label == only]
            if not shapes:
                raise InputError(f"{file}: there is no tree {only!r}; known: {known}")
    if svg:
        _write(render_svg(shapes), output)
    elif dot:
        _write(render_dot(shapes), output)
    elif mermaid:
        _write(render_mermaid(shapes), output)
    elif output is not None:
        try:
            with output.open("w", encoding="utf-8") as stream:
                _print_trees(shapes, Console(file=stream, width=160))
        except OSError as error:
            fail(f"cannot write {output}: {error.strerror}")
    else:
        _print_trees(shapes, console)


def _print_trees(shapes: list[Shape], target: Console) -> None:
    for number, shape in enumerate(shapes):
        if number:
            target.print()
        target.print(render_text(shape), highlight=False)


def _shapes(file: Path) -> list[Shape]:
    if _is_mission(file):
        mission = read_mission(file)
        return mission_shapes(mission.name, mission.tree)
    library, findings = read_tree_file(file)
    count = len(findings.errors)
    if count:
        what = "an error" if count == 1 else f"{count} errors"
        _print_line(errors, "warning:", "yellow", f"{what} in {file}: mrbt tree check says which")
    return file_shapes(library)


@tree_app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="File to read (.xml or .yaml).", metavar="IN")],
    target: Annotated[Path, typer.Argument(help="File to write (.xml).", metavar="OUT")],
    as_compact: Annotated[
        bool, typer.Option("--compact", help="<Foo/> instead of <Action ID='Foo'/>.")
    ] = False,
    merge: Annotated[
        bool, typer.Option("--merge", help="Put the trees of included files into OUT.")
    ] = False,
    ids: Annotated[
        bool, typer.Option("--ids", help="As a monitor sees it: a tree per SubTree, with _uid.")
    ] = False,
) -> None:
    """Write a tree as BehaviorTree.CPP 4 XML that Groot2 opens: explicit, with all models.

    Example: mrbt tree convert old_v3.xml new_v4.xml
    """
    with input_errors():
        if target.suffix.lower() != ".xml":
            raise InputError(f"{target}: the file to write has to end in .xml")
        if ids and (merge or as_compact):
            raise InputError("--ids goes without --merge and --compact")
        document, found = _converted(source, merge, ids)
        text = (compact(document) if as_compact else document).text()
    for finding in found:
        _print_finding(finding, errors)
    _write(text, target)
    trees = len(document.trees)
    count = f"{trees} tree{'s' if trees > 1 else ''}"
    _print_line(console, "written", "bold green", f"{target}: {count}")


def _converted(source: Path, merge: bool, ids: bool) -> tuple[Document, list[Finding]]:
    findings = Findings()
    if _is_mission(source):
        if ids or merge:
            raise InputError("--ids and --merge are for BehaviorTree.CPP files")
        return explicit(_library_of_mission(source)), []
    library, findings = read_tree_file(source)
    findings.raise_errors()
    document = with_ids(library) if ids else explicit(library, is_merged=merge)
    return document, findings.warnings


def _library_of_mission(source: Path) -> Library:
    library = Library()
    library.add(team_tree_document(read_mission(source).tree.spec(), str(source)))
    return library


@tree_app.command()
def check(
    file: FileArgument,
    strict: Annotated[
        bool, typer.Option("--strict", help="Every rule of BehaviorTree.CPP 4, to the letter.")
    ] = False,
    team: Annotated[
        bool,
        typer.Option("--team", help="Also say what a team cannot carry out, or does otherwise."),
    ] = False,
    assume_actions: Annotated[
        bool, typer.Option("--assume-actions", help="With --team: leaves without a model.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check a file; exit status 2 if there are errors.

    Example: mrbt tree check navigate.xml --strict
    """
    if assume_actions and not team:
        fail("--assume-actions goes with --team")
    with input_errors():
        if _is_mission(file):
            _check_mission(file, as_json)
            return
        try:
            library, findings = read_tree_file(file, strict)
        except TreeFileError as error:
            if not as_json:
                raise
            _print_unreadable(file, error)
            raise typer.Exit(BAD_INPUT) from None
        refusals: tuple[Problem, ...] = ()
        notes: tuple[Problem, ...] = ()
        main = library.main_tree
        if team and not findings.errors:
            if main is None:
                raise InputError(f"{file}: main_tree_to_execute has to name a tree")
            leaves = Category.ACTION if assume_actions else None
            found = to_team_tree(library, main, leaves)
            refusals, notes = found.refusals, found.notes
    is_valid = not findings.errors and not refusals
    counts = {
        "files": len(library.documents),
        "trees": len(library.trees),
        "nodes": sum(len(list(s.element.walk())) - 1 for s in library.trees.values()),
    }
    if as_json:
        data = {"file": str(file), "valid": is_valid, **counts}
        data["findings"] = [finding.to_json() for finding in findings.in_order()]
        if team:
            data["refusals"] = [_reason_json(problem) for problem in refusals]
            data["notes"] = [_reason_json(problem) for problem in notes]
        print_json(data)
    else:
        _print_check(file, counts, findings, refusals, notes)
    if not is_valid:
        raise typer.Exit(BAD_INPUT)


def _print_unreadable(file: Path, error: TreeFileError) -> None:
    found = [Finding(Severity.ERROR, problem).to_json() for problem in error.problems]
    data = {"file": str(file), "valid": False, "files": 0, "trees": 0, "nodes": 0}
    print_json({**data, "findings": found})


def _reason_json(problem: Problem) -> dict[str, str | int]:
    return {
        "file": problem.file,
        "line": problem.line,
        "path": problem.path,
        "reason": problem.message,
    }


def _print_check(
    file: Path,
    counts: dict[str, int],
    findings: Findings,
    refusals: tuple[Problem, ...],
    notes: tuple[Problem, ...],
) -> None:
    for finding in findings.in_order():
        _print_finding(finding, errors)
    if findings.is_full:
        _print_line(errors, "error:", "bold red", "and more")
    for problem in refusals:
        _print_line(errors, "not for a team:", "bold red", str(problem))
    for problem in notes:
        _print_line(errors, "note:", "cyan", str(problem))
    if findings.errors or refusals:
        return
    listed = ", ".join(
        f"{count} {name if count != 1 else name[:-1]}" for name, count in counts.items()
    )
    _print_line(console, "valid", "bold green", f"{file}: {listed}")


def _check_mission(file: Path, as_json: bool) -> None:
    mission = read_mission(file)
    warnings = mission_warnings(mission)
    nodes = len(mission.tree.nodes)
    if as_json:
        found = [
            {"severity": "warning", "file": str(file), "line": 0, "path": "", "message": text}
            for text in warnings
        ]
        data = {"file": str(file), "valid": True, "files": 1, "trees": 1, "nodes": nodes}
        print_json({**data, "findings": found})
        return
    for text in warnings:
        _print_line(errors, "warning:", "yellow", text)
    _print_line(console, "valid", "bold green", f"{file}: a mission, {nodes} nodes")
