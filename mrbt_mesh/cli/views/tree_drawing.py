"""Draw trees: as text in a terminal, and in the languages dot and Mermaid."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.text import Text
from rich.tree import Tree as RichTree

from mrbt_mesh.cli.views.tree_shapes import Look, Shape

PLAIN_WIDTH = 160
_STYLES = {
    Look.CONTROL: "bold cyan",
    Look.DECORATOR: "magenta",
    Look.ACTION: "green",
    Look.CONDITION: "yellow",
    Look.SUBTREE: "bold blue",
    Look.TREE: "bold",
}
# Fill and border.
COLOURS = {
    Look.CONTROL: ("#e0f2fe", "#0369a1"),
    Look.DECORATOR: ("#fae8ff", "#a21caf"),
    Look.ACTION: ("#dcfce7", "#15803d"),
    Look.CONDITION: ("#fef9c3", "#a16207"),
    Look.SUBTREE: ("#e0e7ff", "#4338ca"),
    Look.TREE: ("#f1f5f9", "#334155"),
}


def render_text(shape: Shape) -> RichTree:
    """A tree for the terminal."""

    def label(node: Shape) -> Text:
        text = Text.assemble(
            (f"{node.symbol} ", _STYLES[node.look]), (node.label, _STYLES[node.look])
        )
        if node.notes:
            text.append("  " + ", ".join(node.notes), style="dim")
        return text

    def add(node: Shape, branch: RichTree) -> None:
        for child in node.children:
            add(child, branch.add(label(child)))

    root = RichTree(label(shape), guide_style="dim")
    add(shape, root)
    return root


def _numbered(shapes: Sequence[Shape]) -> Iterator[tuple[int, Shape, int | None]]:
    """Every node with its number and its parent's, in preorder."""
    number = 0
    waiting: list[tuple[Shape, int | None]] = [(shape, None) for shape in reversed(shapes)]
    while waiting:
        shape, parent = waiting.pop()
        yield number, shape, parent
        waiting.extend((child, number) for child in reversed(shape.children))
        number += 1


def render_dot(shapes: Sequence[Shape]) -> str:
    """A graph for Graphviz: `dot -Tpdf`."""
    lines = [
        "digraph tree {",
        "  graph [ordering=out, nodesep=0.2];",
        '  node [fontname="sans-serif", fontsize=11, style="filled,rounded", shape=box];',
        "  edge [arrowhead=none];",
    ]
    for number, shape, parent in _numbered(shapes):
        text = "\\n".join(
            _dot_text(line) for line in [f"{shape.symbol} {shape.label}", *shape.notes]
        )
        fill, border = COLOURS[shape.look]
        ellipse = ", shape=ellipse" if shape.look is Look.CONDITION else ""
        lines.append(
            f'  n{number} [label="{text}", fillcolor="{fill}", color="{border}"{ellipse}];'
        )
        if parent is not None:
            lines.append(f"  n{parent} -> n{number};")
    return "\n".join([*lines, "}"]) + "\n"


def _dot_text(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", " ")


def render_mermaid(shapes: Sequence[Shape]) -> str:
    """A Mermaid flowchart, as Markdown viewers draw it."""
    lines = ["flowchart TD"]
    for number, shape, parent in _numbered(shapes):
        text = "<br>".join(
            _mermaid_text(line) for line in [f"{shape.symbol} {shape.label}", *shape.notes]
        )
        opening, closing = ("([", "])") if shape.look is Look.CONDITION else ("[", "]")
        lines.append(f'  n{number}{opening}"{text}"{closing}:::{shape.look}')
        if parent is not None:
            lines.append(f"  n{parent} --- n{number}")
    for look, (fill, border) in COLOURS.items():
        lines.append(f"  classDef {look} fill:{fill},stroke:{border},color:#0f172a")
    return "\n".join(lines) + "\n"


def _mermaid_text(text: str) -> str:
    """Mermaid reads quotes and Markdown in labels; character codes are safe."""
    return "".join(
        character
        if character.isalnum() or character in " _.,:=()-" or ord(character) > 127
        else f"#{ord(character)};"
        for character in text
    )


def plain_text(shapes: Sequence[Shape]) -> str:
    """The trees as a terminal without colours shows them."""
    drawn = io.StringIO()
    console = Console(file=drawn, width=PLAIN_WIDTH)
    for number, shape in enumerate(shapes):
        if number:
            console.print()
        console.print(render_text(shape), highlight=False)
    return drawn.getvalue()
