"""A mission and a robot of one's own out of a BehaviorTree.CPP file, as `mrbt new --btcpp` writes.

The tree is lifted in units for three robots, and each of its leaves is a function that takes time
and succeeds: what is to be filled in.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

from mrbt_mesh.analysis.lift_units import check_subtrees
from mrbt_mesh.cli.trees.lifting import LiftRequest, library_and_tree, lift_files
from mrbt_mesh.cli.trees.program_from_tree import program_text
from mrbt_mesh.formats.btcpp.expand import expand
from mrbt_mesh.formats.btcpp.export import explicit
from mrbt_mesh.formats.btcpp.library import Library
from mrbt_mesh.formats.btcpp.loadable import loadable

TEAM = """\
# The team that {tree} is for. Lift it again after a change:
#
#     mrbt lift {tree} --robots team.yaml --units auto -o mission.yaml
#
# What `local_tasks`, `conditions` and `capabilities` may say is in docs/lift.md.

program: robot.py
local_tasks: {{}}
robot_types: {{robot: {{capabilities: {{}}}}}}
robots: {{R1: robot, R2: robot, R3: robot}}
"""
TEST = '''\
"""What the team must do, in virtual time and with faults. Run it with `pytest`."""

from mrbt_mesh.testing import Kill, RunMission


def test_whoever_dies_is_replaced(run_mission: RunMission) -> None:
    usual = run_mission("mission.yaml")
    run = run_mission("mission.yaml", faults=[(1, Kill("R1"))])
    assert run.result == usual.result
'''


def files_from_tree(
    file: Path, tree_id: str | None, others: Library, actions: Sequence[str] = ()
) -> dict[str, str]:
    """The texts by file name, of this tree or the main one; `others` has SubTrees and models.

    `actions`: SubTrees that are in no file and become actions of the program. An <include> that
    cannot be read is left out if no tree of it is needed. Raises InputError, TreeFileError and
    MissionError.
    """
    library, main = library_and_tree(file, tree_id, others, actions)
    library.take_in(main)
    check_subtrees(expand(library, main))
    tree = f"{re.sub(r'[^A-Za-z0-9_-]', '_', file.stem)}.xml"
    document = loadable(explicit(library, is_merged=True))
    document.root.attributes["main_tree_to_execute"] = main
    files = {
        tree: document.text(),
        "team.yaml": TEAM.format(tree=tree),
        "robot.py": program_text(library, main, tree),
        "test_mission.py": TEST,
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in files.items():
            (folder / path).write_text(text, encoding="utf-8")
        mission = folder / "mission.yaml"
        request = LiftRequest(
            folder / tree, folder / "team.yaml", mission, main, (), (), (), "auto"
        )
        lifted = {path.name: text for path, text in lift_files(request).files.items()}
    return {**lifted, **files}
