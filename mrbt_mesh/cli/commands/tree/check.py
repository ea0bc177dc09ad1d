"""`mrbt tree check`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import JsonOption, TreeFileArgument


def check(
    file: TreeFileArgument,
    given: Given,
    strict: Annotated[bool, option("Every rule of BehaviorTree.CPP 4, to the letter.")] = False,
    team: Annotated[
        bool, option("Also say what a team cannot carry out, or does otherwise.")
    ] = False,
    assume_actions: Annotated[bool, option("With --team: leaves without a model.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Check a file; exit status 2 if there are errors.

    Example: mrbt tree check navigate.xml --strict
    """
    from mrbt_mesh.cli.trees.checking import check_mission, check_tree_file
    from mrbt_mesh.cli.trees.files import is_mission

    if not team:
        given.refuse(["--assume-actions"], "goes with --team")
    if is_mission(file):
        given.refuse(["--strict", "--team"], "for BehaviorTree.CPP files, not for missions")
        check_mission(file, as_json)
    else:
        check_tree_file(file, strict, team, assume_actions, as_json)
