"""What `mrbt lift` reads, and the text of the mission that it writes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from mrbt_mesh.analysis.lift_mission import LiftedMission, heading
from mrbt_mesh.cli.trees.files import read_tree_file
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.btcpp.document import read_document
from mrbt_mesh.formats.btcpp.folder import read_folder
from mrbt_mesh.formats.btcpp.library import Library, together
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_writer import mission_text
from mrbt_mesh.formats.problems import MissionError, Problem


def known_besides(models: Sequence[Path], folders: Sequence[Path]) -> Library:
    """The trees and models of other files, and of all files of folders; raises InputError."""
    documents = [read_document(path) for path in models]
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"--trees {folder}: there is no such folder")
        documents += read_folder(folder).documents.values()
    return together(documents)


def library_and_tree(file: Path, tree: str | None, others: Library) -> tuple[Library, str]:
    """The checked file and the ID of the tree to lift; raises InputError."""
    library, findings = read_tree_file(file, others=others)
    findings.raise_errors()
    name = tree or library.main_tree
    if name is None or name not in library.trees:
        known = ", ".join(library.own_trees) or "none"
        what = f"there is no tree {tree!r}" if tree else "no tree is named as the main one"
        raise InputError(f"{file}: {what}; choose with --tree (there are: {known})")
    return library, name


def mission_name(file: Path) -> str:
    """A mission's name, made out of a file's."""
    name = "".join(c if c.isalnum() or c == "_" else "_" for c in file.stem)
    return name if name[:1].isalpha() else f"mission_{name}"


def checked_text(
    found: LiftedMission, tree: str, file: Path, robots: Path, output: Path | None
) -> str:
    """The mission file's text, with `program` relative to where it is written.

    Raises MissionError if the team file does not fit the tree.
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
        mission_from_yaml(text, str(output or "the mission"), target)
    except MissionError as error:
        first = Problem(
            str(robots), 0, "", "does not fit the tree; the mission would have these problems"
        )
        raise MissionError([first, *error.problems]) from None
    return text
