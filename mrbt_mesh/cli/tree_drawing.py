"""Draw trees: as text in a terminal, in the languages dot and Mermaid, and as SVG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape

from rich.text import Text
from rich.tree import Tree as RichTree

from mrbt_mesh.cli.tree_shapes import Look, Shape

_STYLES = {
    Look.CONTROL: "bold cyan",
    Look.DECORATOR: "magenta",
    Look.ACTION: "green",
    Look.CONDITION: "yellow",
    Look.SUBTREE: "bold blue",
    Look.TREE: "bold",
}
# Fill and border.
_COLOURS = {
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
        fill, border = _COLOURS[shape.look]
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
    for look, (fill, border) in _COLOURS.items():
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


_LINE, _PADDING, _GAP_X, _GAP_Y, _MARGIN = 16, 10, 14, 34, 16
# Of one character of a label and of a note.
_LABEL_WIDTH, _NOTE_WIDTH = 13 * 0.61, 10.5 * 0.61


@dataclass(slots=True)
class _Box:
    """A placed node: left edge, top edge, size, and the width of all that hangs below it."""

    shape: Shape
    width: float
    height: float
    children: list[_Box] = field(default_factory=list)
    span: float = 0
    x: float = 0
    y: float = 0


def render_svg(shapes: Sequence[Shape]) -> str:
    """A picture, one tree below the other, that browsers open without anything else."""
    parts: list[str] = []
    top, right = float(_MARGIN), 0.0
    for shape in shapes:
        box = _measured(shape)
        bottom = _place(box, _MARGIN, top)
        right = max(right, _MARGIN + box.span)
        parts.extend(_drawn(box))
        top = bottom + _GAP_Y
    width, height = right + _MARGIN, top - _GAP_Y + _MARGIN
    style = (
        "text{font:13px ui-monospace,'DejaVu Sans Mono',monospace;fill:#0f172a;text-anchor:middle}"
        ".note{font-size:10.5px;fill:#475569}"
        ".edge{fill:none;stroke:#94a3b8;stroke-width:1.3}"
    )
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}"><style>{style}</style>'
        f'<rect width="100%" height="100%" fill="white"/>'
    )
    return "\n".join([head, *parts, "</svg>"]) + "\n"


def _measured(shape: Shape) -> _Box:
    label_width = (len(shape.label) + len(shape.symbol) + 1) * _LABEL_WIDTH
    note_width = max((len(note) for note in shape.notes), default=0) * _NOTE_WIDTH
    width = max(label_width, note_width, 30) + 2 * _PADDING
    height = _LINE + _LINE * 0.85 * len(shape.notes) + _PADDING
    box = _Box(shape, width, height, [_measured(child) for child in shape.children])
    below = sum(child.span for child in box.children) + _GAP_X * max(len(box.children) - 1, 0)
    box.span = max(width, below)
    return box


def _place(box: _Box, left: float, top: float) -> float:
    """Put a box above the middle of its children; returns the lowest edge."""
    below = sum(child.span for child in box.children) + _GAP_X * max(len(box.children) - 1, 0)
    x = left + (box.span - below) / 2
    bottom = top + box.height
    for child in box.children:
        bottom = max(bottom, _place(child, x, top + box.height + _GAP_Y))
        x += child.span + _GAP_X
    if box.children:
        first, last = box.children[0], box.children[-1]
        middle = (first.x + first.width / 2 + last.x + last.width / 2) / 2
        box.x = min(max(middle - box.width / 2, left), left + box.span - box.width)
    else:
        box.x = left + (box.span - box.width) / 2
    box.y = top
    return bottom


def _drawn(box: _Box) -> Iterator[str]:
    fill, border = _COLOURS[box.shape.look]
    middle = box.x + box.width / 2
    for child in box.children:
        start, end = box.y + box.height, child.y
        to = child.x + child.width / 2
        half = (start + end) / 2
        yield (
            f'<path class="edge" d="M{middle:.1f} {start:.1f} C{middle:.1f} {half:.1f} '
            f'{to:.1f} {half:.1f} {to:.1f} {end:.1f}"/>'
        )
    radius = box.height / 2 if box.shape.look is Look.CONDITION else 5
    dashes = ' stroke-dasharray="5 3"' if box.shape.look is Look.SUBTREE else ""
    yield (
        f'<rect x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" height="{box.height:.1f}" '
        f'rx="{min(radius, 16):.1f}" fill="{fill}" stroke="{border}"{dashes}/>'
    )
    y = box.y + _PADDING / 2 + 12
    label = escape(f"{box.shape.symbol} {box.shape.label}")
    yield f'<text x="{middle:.1f}" y="{y:.1f}">{label}</text>'
    for note in box.shape.notes:
        y += _LINE * 0.85
        yield f'<text class="note" x="{middle:.1f}" y="{y:.1f}">{escape(note)}</text>'
    for child in box.children:
        yield from _drawn(child)
