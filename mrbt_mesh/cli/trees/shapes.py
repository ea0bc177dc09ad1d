"""The trees of a file, as they are drawn."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.cli.framework.terminal import errors, labelled
from mrbt_mesh.cli.trees.files import is_mission, read_tree_file
from mrbt_mesh.cli.views.tree_shapes import Shape, file_shapes, mission_shapes
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission


def shapes_of(file: Path, only: str | None) -> list[Shape]:
    """All trees of a file, or only the one of an ID.

    Raises InputError for what cannot be read. A file with errors is drawn as far as it goes.
    """
    shapes = _shapes(file)
    if only is None:
        return shapes
    chosen = [shape for shape in shapes if shape.label == only]
    if not chosen:
        known = ", ".join(shape.label for shape in shapes)
        raise InputError(f"{file}: there is no tree {only!r}; known: {known}")
    return chosen


def _shapes(file: Path) -> list[Shape]:
    if is_mission(file):
        mission = load_mission(file)
        return mission_shapes(mission.name, mission.tree)
    library, findings = read_tree_file(file)
    count = len(findings.errors)
    if count:
        what = "an error" if count == 1 else f"{count} errors"
        text = f"{what} in {file}: mrbt tree check says which"
        errors.print(labelled("warning", "yellow", text), soft_wrap=True)
    return file_shapes(library)
