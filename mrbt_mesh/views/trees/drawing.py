"""Draw trees: as text in a terminal, and as Mermaid flowcharts."""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.cli.printing import PrintedTree, Styled
from mrbt_mesh.views.trees.shapes import Shape

# Look -> style in a terminal, fill and border of a flowchart.
COLOURS = {
    "control": ("bold cyan", "#e0f2fe", "#0369a1"),
    "decorator": ("magenta", "#fae8ff", "#a21caf"),
    "action": ("green", "#dcfce7", "#15803d"),
    "condition": ("yellow", "#fef9c3", "#a16207"),
    "subtree": ("bold blue", "#e0e7ff", "#4338ca"),
    "tree": ("bold", "#f1f5f9", "#334155"),
}


def render_text(shape: Shape, parent: PrintedTree | None = None) -> PrintedTree:
    """Return a tree for the terminal."""
    text = Styled(f"{shape.symbol} {shape.label}", COLOURS[shape.look][0])
    if shape.notes:
        text = Styled.assemble(text, ("  " + ", ".join(shape.notes), "dim"))
    branch = PrintedTree(text) if parent is None else parent.add(text)
    for child in shape.children:
        render_text(child, branch)
    return branch


def render_mermaid(shapes: Sequence[Shape]) -> str:
    """Return a Mermaid flowchart, as Markdown viewers draw it."""
    lines = ["flowchart TD"]
    waiting: list[tuple[Shape, int | None]] = [(shape, None) for shape in reversed(shapes)]
    number = 0
    while waiting:
        shape, parent = waiting.pop()
        text = "<br>".join(map(_escaped, [f"{shape.symbol} {shape.label}", *shape.notes]))
        opening, closing = ("([", "])") if shape.look == "condition" else ("[", "]")
        lines.append(f'  n{number}{opening}"{text}"{closing}:::{shape.look}')
        if parent is not None:
            lines.append(f"  n{parent} --- n{number}")
        waiting.extend((child, number) for child in reversed(shape.children))
        number += 1
    for look, (_, fill, border) in COLOURS.items():
        lines.append(f"  classDef {look} fill:{fill},stroke:{border},color:#0f172a")
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    """Escape a label: Mermaid reads quotes and Markdown in labels, but character codes are safe."""
    return "".join(
        character
        if character.isalnum() or character in " _.,:=()-" or ord(character) > 127
        else f"#{ord(character)};"
        for character in text
    )
