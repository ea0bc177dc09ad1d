"""A mission and a robot of one's own out of a BehaviorTree.CPP file: `mrbt tree lift --new`.

The tree is lifted in units for three robots, and each of its leaves is a function that takes time
and succeeds, to be filled in.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from shlex import quote

import click

from mrbt_mesh.analysis.lift.files import (
    LiftedFiles,
    LiftRequest,
    known_besides,
    library_and_tree,
    lift_tree,
)
from mrbt_mesh.analysis.lift.in_units import check_subtrees
from mrbt_mesh.analysis.lift.program import program_text
from mrbt_mesh.analysis.lift.render import render_units
from mrbt_mesh.btcpp.files.expand import expand
from mrbt_mesh.btcpp.files.export import explicit
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.files.loadable import loadable
from mrbt_mesh.cli.terminal import console, note
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.shipped import mission_name, write_files
from mrbt_mesh.formats.team_file import load_team

TEAM = """\
# The team that {tree} is for. Lift it again after a change:
#
#     mrbt tree lift {tree} --robots team.yaml --units auto -o mission.yaml
#
# Actions that declare nothing stay together on one robot. With declarations, parts of the
# tree can go to different robots: docs/how-to/lift.md.

mission: {name}
program: robot.py
local_tasks: {{}}
robot_types: {{robot: {{capabilities: {{}}}}}}
robots: {{R1: robot, R2: robot, R3: robot}}
"""
TEST = '''\
"""The mission in virtual time, also with a fault. Run it with `pytest`.

A warning names each condition of robot.py that is not filled in yet, and answers True.
"""

from mrbt_mesh.testing import Kill, RunMission


def test_the_mission_succeeds(run_mission: RunMission) -> None:
    assert run_mission("mission.yaml").result == "success"


def test_another_robot_replaces_one_that_dies(run_mission: RunMission) -> None:
    assert run_mission("mission.yaml", faults=[(1, Kill("R1"))]).result == "success"
'''


def files_from_tree(
    folder: Path, file: Path, tree_id: str | None, others: Library, actions: Sequence[str] = ()
) -> tuple[dict[str, str], LiftedFiles]:
    """The texts by file name, of this tree or the main one, and how the tree was lifted.

    `folder` is where they will be; `others` has SubTrees and models. `actions`: SubTrees that are
    in no file and become actions of the program. An <include> that cannot be read is left out if
    no tree of it is needed. Raises InputError and FileError.
    """
    library, main = library_and_tree(file, tree_id, others, actions)
    library.take_in(main)
    check_subtrees(expand(library, main))
    tree = f"{re.sub(r'[^A-Za-z0-9_-]', '_', file.stem)}.xml"
    document = loadable(explicit(library, is_merged=True))
    document.root.attributes["main_tree_to_execute"] = main
    team = TEAM.format(tree=tree, name=mission_name(folder.resolve().name))
    files = {
        tree: document.text(),
        "team.yaml": team,
        "robot.py": program_text(library, main, tree),
        "test_mission.py": TEST,
    }
    mission, robots = folder / "mission.yaml", folder / "team.yaml"
    request = LiftRequest(folder / tree, robots, mission, main, (), (), (), "auto")
    lifted = lift_tree(library, main, load_team(robots, team), request)
    return {path.name: text for path, text in lifted.files.items()} | files, lifted


def write_folder(
    folder: Path,
    file: Path,
    tree: str | None,
    models: Sequence[Path],
    folders: Sequence[Path],
    actions: Sequence[str],
) -> None:
    """Write all files of a tree's team into a new folder, and explain how the tree was lifted.

    Raises InputError.
    """
    others = known_besides(models, folders)
    files, lifted = files_from_tree(folder, file, tree, others, actions)
    try:
        written = write_files(folder, files)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    for path in written:
        click.echo(f"wrote {path}")
    if lifted.units is not None:
        console.print()
        console.print(render_units(lifted.units), soft_wrap=True)
    for remark in lifted.mission.notes:
        note(str(remark))
    click.echo(f"\nnow: mrbt up {quote(str(folder / 'mission.yaml'))}")
