"""`mrbt tree`: trees of BehaviorTree.CPP files and of missions."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from mrbt_mesh.cli.command import FAILURE, PATH, SUCCESS, CommandGroup, refuse
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.errors import InputError


@click.group(cls=CommandGroup)
def tree() -> None:
    """Show, check, convert, run and lift trees.

    Those of BehaviorTree.CPP files, and of missions.

    Example: mrbt tree show examples/vehicle_repair/mission.yaml
    """


@tree.command()
@click.argument("file", type=PATH, help="BehaviorTree.CPP file (.xml) or mission (.yaml).")
@click.option("--mermaid", is_flag=True, help="As a Mermaid flowchart, for Markdown.")
@click.option("--robot", metavar="A1,...", help="The trees T_i of these robots of a mission.")
@click.option("--only", metavar="ID", help="Only the tree of this ID.")
@json_option
def show(file: Path, mermaid: bool, robot: str | None, only: str | None, as_json: bool) -> None:
    """Draw the trees of a file, or the whole tree of a mission's robot.

    \b
    Example: mrbt tree show navigate.xml
             mrbt tree show examples/vehicle_repair/mission.yaml --robot A1
    """
    from mrbt_mesh.cli.terminal import console, print_json
    from mrbt_mesh.views.trees.drawing import render_mermaid, render_text
    from mrbt_mesh.views.trees.shapes import shapes_of

    if mermaid and as_json:
        raise InputError("--mermaid and --json: give one of them")
    if robot is not None and only is not None:
        raise InputError("give --robot or --only: a robot's tree has no ID")
    shapes = shapes_of(file, only, robot)
    if as_json:
        print_json({"trees": [shape.to_json() for shape in shapes]})
    elif mermaid:
        sys.stdout.write(render_mermaid(shapes))
    else:
        for number, shape in enumerate(shapes):
            console.print(*([""] if number else []), render_text(shape))


@tree.command("check")
@click.argument("file", type=PATH, help="BehaviorTree.CPP file (.xml), folder of them, or mission.")
@click.option("--strict", is_flag=True, help="Every rule of BehaviorTree.CPP 4.10.")
@click.option("--team", is_flag=True, help="Also what a team cannot do.")
@click.option("--assume-actions", is_flag=True, help="With --team: leaves without a model.")
@json_option
def check_(file: Path, strict: bool, team: bool, assume_actions: bool, as_json: bool) -> None:
    """Check a file, or all files of a folder; exit status 2 if there are errors.

    The files of a folder know each other's trees and models.

    Example: mrbt tree check navigate.xml --strict
    """
    from mrbt_mesh.views.trees.checking import TreeCheck, check_mission
    from mrbt_mesh.views.trees.shapes import is_mission

    if not team:
        refuse("goes with --team", "--assume-actions")
    check = TreeCheck(strict, team, assume_actions, as_json)
    if file.is_dir():
        check.folder(file)
    elif is_mission(file):
        refuse("for BehaviorTree.CPP files, not for missions", "--strict", "--team")
        check_mission(file, as_json)
    else:
        check.file(file)


@tree.command()
@click.argument("source", metavar="IN", type=PATH, help="File (.xml, .yaml) or folder to read.")
@click.argument("target", metavar="OUT", type=PATH, help="File (.xml) or folder to write.")
@click.option("--compact", is_flag=True, help="<Foo/> instead of <Action ID='Foo'/>.")
@click.option("--merge", is_flag=True, help="Put the trees of included files into OUT.")
@click.option("--ids", is_flag=True, help="As a monitor shows it: a tree per SubTree, with _uid.")
def convert(source: Path, target: Path, compact: bool, merge: bool, ids: bool) -> None:
    """Write trees as BehaviorTree.CPP 4.10 loads them and Groot2 opens them.

    In the explicit form, with all models. A folder is converted file by file.

    Example: mrbt tree convert old_v3.xml new_v4.xml
    """
    from mrbt_mesh.views.trees.converting import Wanted, convert_file, convert_folder

    if ids and (merge or compact):
        raise InputError("--ids goes without --merge and --compact")
    write = convert_folder if source.is_dir() else convert_file
    write(source, target, Wanted(compact, merge, ids))


@tree.command("run")
@click.argument("file", type=PATH, help="BehaviorTree.CPP file (.xml).")
@click.option("--program", type=PATH, required=True, metavar="FILE.py", help="The tree's leaves.")
@click.option("--tree", "tree_id", metavar="ID", help="The tree. Default: the main tree.")
@click.option("--set", "entries", multiple=True, metavar="NAME=TEXT", help="Set an entry first.")
def run_(file: Path, program: Path, tree_id: str | None, entries: tuple[str, ...]) -> None:
    """Run a tree in Python, on this computer and without a team.

    The program defines a `Leaves` object with the tree's actions and conditions.

    Exit status: 0 the tree succeeded or was skipped, 1 it failed.

    Example: mrbt tree run fetch.xml --program robot.py --set goal=dock
    """
    from mrbt_mesh import btcpp
    from mrbt_mesh.views.trees.checking import print_finding

    def warn(finding: btcpp.Finding) -> None:
        print_finding("warning", finding)

    for entry in entries:
        if "=" not in entry:
            raise InputError(f"--set {entry}: NAME=TEXT is expected, e.g. goal=dock")
    values = dict(entry.split("=", 1) for entry in entries)
    try:
        status = btcpp.run(file, program, tree=tree_id, entries=values, warn=warn)
    except (btcpp.BlackboardError, btcpp.TickError) as error:
        raise InputError(f"{file}: {error}") from None
    click.echo(status.name)
    raise SystemExit(FAILURE if status is btcpp.NodeStatus.FAILURE else SUCCESS)
