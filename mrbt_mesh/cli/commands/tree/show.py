"""`mrbt tree show`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import TreeFileArgument
from mrbt_mesh.errors import InputError


def show(
    file: TreeFileArgument,
    svg: Annotated[bool, option("As a picture (SVG).")] = False,
    dot: Annotated[bool, option("For Graphviz.")] = False,
    mermaid: Annotated[bool, option("For Markdown.")] = False,
    only: Annotated[str | None, option("Only the tree of this ID.", "ID")] = None,
    output: Annotated[
        Path | None, option("Write there instead of to the terminal.", "FILE", short="-o")
    ] = None,
) -> None:
    """Draw the trees of a file.

    Example: mrbt tree show navigate.xml --svg -o navigate.svg
    """
    from mrbt_mesh.cli.framework.terminal import console, write_file
    from mrbt_mesh.cli.trees.shapes import shapes_of
    from mrbt_mesh.cli.views.tree_drawing import plain_text, render_dot, render_mermaid, render_text
    from mrbt_mesh.cli.views.tree_svg import render_svg

    if svg + dot + mermaid > 1:
        raise InputError("give one of --svg, --dot and --mermaid")
    shapes = shapes_of(file, only)
    if not svg and not dot and not mermaid and output is None:
        for number, shape in enumerate(shapes):
            console.print(*([""] if number else []), render_text(shape), sep="\n", highlight=False)
        return
    draw = render_svg if svg else render_dot if dot else render_mermaid if mermaid else plain_text
    text = draw(shapes)
    if output is not None:
        write_file(output, text)
    else:
        sys.stdout.write(text)
