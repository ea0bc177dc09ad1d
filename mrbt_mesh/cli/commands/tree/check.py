"""`mrbt tree check`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, argument, option
from mrbt_mesh.cli.options import JsonOption


def check(
    file: Annotated[
        Path,
        argument("FILE", "BehaviorTree.CPP file (.xml), folder of them, or mission (.yaml)."),
    ],
    given: Given,
    strict: Annotated[bool, option("Every rule of BehaviorTree.CPP 4, to the letter.")] = False,
    team: Annotated[
        bool, option("Also say what a team cannot carry out, or does otherwise.")
    ] = False,
    assume_actions: Annotated[bool, option("With --team: leaves without a model.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Check a file, or all of a folder; exit status 2 if there are errors.

    The files of a folder know each other's trees and models.

    Example: mrbt tree check navigate.xml --strict
    """
    from mrbt_mesh.cli.trees.checking import (
        Asked,
        check_mission,
        check_tree_file,
        check_tree_folder,
    )
    from mrbt_mesh.cli.trees.files import is_mission

    if not team:
        given.refuse(["--assume-actions"], "goes with --team")
    asked = Asked(strict, team, assume_actions, as_json)
    if file.is_dir():
        check_tree_folder(file, asked)
    elif is_mission(file):
        given.refuse(["--strict", "--team"], "for BehaviorTree.CPP files, not for missions")
        check_mission(file, as_json)
    else:
        check_tree_file(file, asked)
