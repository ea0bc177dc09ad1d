"""`mrbt tree lift`: a team's mission out of the tree of one robot."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import Any

import click

from mrbt_mesh.cli.command import PATH, MrbtCommand, refuse
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.core.mission.mission import MAX_ROBOTS
from mrbt_mesh.errors import InputError


@click.command(cls=MrbtCommand)
@click.argument("file", metavar="FILE", type=PATH, help="A robot's tree, BehaviorTree.CPP XML.")
@click.argument(
    "folder",
    metavar="[FOLDER]",
    type=PATH,
    required=False,
    help="A folder that does not exist yet. Default: only explain.",
)
@click.option(
    "--team",
    multiple=True,
    metavar="NODE",
    help="This node (path or name) is a global task, as with _team='true'.",
)
@click.option(
    "--parallel",
    multiple=True,
    metavar="NODE",
    help="The children of this Sequence or Fallback go at once (_parallel='true').",
)
@click.option("--every-action", is_flag=True, help="Every action is a global task.")
@click.option(
    "--robots",
    type=click.IntRange(1, MAX_ROBOTS),
    default=3,
    show_default=True,
    help="How many there are.",
)
@click.option(
    "--program",
    type=PATH,
    metavar="FILE.py",
    help="The robots' program. Default: write one to fill in.",
)
@click.option("--tree", metavar="ID", help="The tree. Default: the main tree.")
@click.option(
    "--models",
    type=PATH,
    multiple=True,
    metavar="FILE",
    help="File with models of nodes, or with SubTrees (.xml).",
)
@click.option(
    "--trees",
    "folders",
    type=PATH,
    multiple=True,
    metavar="DIR",
    help="Folder of tree files with SubTrees and models.",
)
@click.option(
    "--as-action",
    "actions",
    multiple=True,
    metavar="ID",
    help="A SubTree that is in no file becomes an action; '*': all of them.",
)
@json_option
def lift(
    file: Path,
    folder: Path | None,
    team: tuple[str, ...],
    parallel: tuple[str, ...],
    every_action: bool,
    robots: int,
    program: Path | None,
    as_json: bool,
    **where: Any,
) -> None:
    """Make a team's mission out of the tree of one robot.

    The tree is one global task: one robot runs all of it, and another one takes over when it dies,
    from the beginning or from the last node with _checkpoint="true". What has _team="true" is a
    task of its own, and the children of a Sequence or Fallback with _parallel="true" are done at
    the same time. What a mark would break is refused.

    \b
    Example: mrbt tree lift examples/lift/repair.xml my_team
             mrbt tree lift navigate.xml my_team --team Navigate
    """
    from mrbt_mesh.analysis.lift.folder import TreeFiles, explained, lift_files
    from mrbt_mesh.analysis.lift.marks import WantedMarks
    from mrbt_mesh.cli.terminal import print_json
    from mrbt_mesh.formats.shipped import MISSION, write_files

    if folder is None:
        refuse("takes part in a FOLDER", "--program")
    marks = WantedMarks(team, parallel, every_action)
    lifted = lift_files(TreeFiles(file, **where), marks, robots, folder, program)
    if folder is not None:
        try:
            written = write_files(folder, dict(lifted.files))
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    if as_json:
        print_json(
            {
                "mission": str(folder / MISSION) if folder is not None else None,
                "tasks": [
                    {
                        "call": use.call,
                        "tree": use.task.tree,
                        "nodes": [node.path for node in use.piece.nodes],
                        "line": use.piece.nodes[0].line,
                        "checkpoints": use.task.has_checkpoints,
                    }
                    for use in lifted.uses
                ],
            }
        )
        return
    for line in explained(lifted):
        click.echo(line)
    if folder is not None:
        for path in written:
            click.echo(f"wrote {path}")
        click.echo(f"\nnow: mrbt up {quote(str(folder / MISSION))}")
