"""`mrbt tree lift`: a team's mission out of the tree of one robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mrbt_mesh.cli.command import PATH, MrbtCommand, refuse
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.errors import InputError


@click.command(cls=MrbtCommand)
@click.argument("file", metavar="FILE", type=PATH, help="A robot's tree, BehaviorTree.CPP XML.")
@click.option(
    "--robots",
    type=PATH,
    metavar="FILE",
    help="Team file: robots, and what their local tasks do (.yaml).",
)
@click.option(
    "--new",
    "folder",
    type=PATH,
    metavar="FOLDER",
    help="Instead: a new folder with mission, team and a robot's program to fill in.",
)
@click.option(
    "--output", "-o", type=PATH, metavar="FILE", help="The mission to write. Default: only explain."
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
@click.option(
    "--assume-independent",
    "independent",
    multiple=True,
    metavar="NODE",
    help="Children of this node (path or name) do not depend on one another.",
)
@click.option(
    "--units",
    metavar="auto|FILE",
    help="Keep on one robot nodes that share a blackboard: automatically, or by a file (.yaml).",
)
@json_option
def lift(file: Path, robots: Path | None, folder: Path | None, as_json: bool, **how: Any) -> None:
    """Make a team's mission out of the tree of one robot, and explain it.

    Every action becomes a global task for one robot (paper, section V-A). What may happen at the
    same time follows from what actions declare to read, change and need; without declarations
    nothing is parallel. With --units, parts that share a blackboard or other things of one robot
    become local tasks with trees of their own, in a file beside the mission.

    \b
    Example: mrbt tree lift examples/lift/repair.xml --robots examples/lift/team.yaml
             mrbt tree lift navigate.xml --new my_team
    """
    from mrbt_mesh.analysis.lift.files import LiftRequest, lift_files, print_lifted
    from mrbt_mesh.analysis.lift.new_folder import write_folder

    if folder is not None:
        others = ("--robots", "--output", "--units", "--assume-independent", "--json")
        refuse("not with --new, which writes all files", *others)
        write_folder(folder, file, how["tree"], how["models"], how["folders"], how["actions"])
        return
    if robots is None:
        raise InputError("give the team file with --robots, or --new FOLDER")
    done = lift_files(LiftRequest(file, robots, **how))
    print_lifted(done, how["output"], as_json)
