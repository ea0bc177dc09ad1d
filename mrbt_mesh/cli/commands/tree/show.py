"""`mrbt tree show`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import JsonOption, TreeFileArgument
from mrbt_mesh.errors import InputError


def show(
    file: TreeFileArgument,
    svg: Annotated[bool, option("As a picture (SVG).")] = False,
    dot: Annotated[bool, option("For Graphviz.")] = False,
    mermaid: Annotated[bool, option("For Markdown.")] = False,
    robot: Annotated[
        str | None, option("The whole tree of this robot: T_i with T_A, T_G and T_Li.", "A1,...")
    ] = None,
    only: Annotated[str | None, option("Only the tree of this ID.", "ID")] = None,
    output: Annotated[
        Path | None, option("Write there instead of to the terminal.", "FILE", short="-o")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Draw the trees of a file, or all that a robot of a mission runs.

    Example: mrbt tree show navigate.xml --svg -o navigate.svg
    """
    from mrbt_mesh.cli.framework.terminal import console, json_text, write_file
    from mrbt_mesh.cli.trees.shapes import shapes_of, shapes_of_robots
    from mrbt_mesh.cli.views.tree_drawing import plain_text, render_dot, render_mermaid, render_text
    from mrbt_mesh.cli.views.tree_svg import render_svg

    if svg + dot + mermaid + as_json > 1:
        raise InputError("give one of --svg, --dot, --mermaid and --json")
    if robot is not None and only is not None:
        raise InputError("give --robot or --only: a robot's tree has no ID")
    shapes = shapes_of(file, only) if robot is None else shapes_of_robots(file, robot)
    if not svg and not dot and not mermaid and not as_json and output is None:
        for number, shape in enumerate(shapes):
            console.print(*([""] if number else []), render_text(shape), sep="\n", highlight=False)
        return
    if as_json:
        text = json_text({"trees": [shape.to_json() for shape in shapes]})
    else:
        picture = render_svg if svg else render_dot if dot else render_mermaid
        text = (picture if svg or dot or mermaid else plain_text)(shapes)
    if output is not None:
        write_file(output, text)
    else:
        sys.stdout.write(text)
