"""The trees of a file, as they are drawn."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.cli.options import chosen_robots
from mrbt_mesh.cli.terminal import errors, labelled
from mrbt_mesh.cli.trees.files import is_mission, read_tree_file
from mrbt_mesh.cli.views.tree_shapes import Shape, file_shapes, mission_shapes, robot_shape
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


def shapes_of_robots(file: Path, robots: str) -> list[Shape]:
    """The trees T_i that robots of a mission run, of which there is one or several: `A1,B1`.

    Raises InputError for what cannot be read, is no mission, or has no such robot.
    """
    if not is_mission(file):
        raise InputError(f"{file}: --robot is for mission files (.yaml), which name robots")
    mission = load_mission(file)
    return [robot_shape(mission, robot) for robot in chosen_robots("--robot", robots, mission)]


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
