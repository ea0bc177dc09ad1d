"""Draw trees as SVG, which browsers open without anything else.

A tree grows downwards; one that would become very wide grows to the right instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape

from mrbt_mesh.cli.views.tree_drawing import COLOURS
from mrbt_mesh.cli.views.tree_shapes import Look, Shape

LINE, PADDING, MARGIN = 16, 10, 16
# Between neighbours, and between a parent and its children.
GAP, GAP_BELOW, GAP_RIGHT = 14, 34, 46
MAX_WIDTH = 1800
# Of one character of a label and of a note.
LABEL_WIDTH, NOTE_WIDTH = 13 * 0.61, 10.5 * 0.61
NOTE_HEIGHT = LINE * 0.85
STYLE = (
    "text{font:13px ui-monospace,'DejaVu Sans Mono',monospace;fill:#0f172a;text-anchor:middle}"
    ".note{font-size:10.5px;fill:#475569}"
    ".edge{fill:none;stroke:#94a3b8;stroke-width:1.3}"
)


@dataclass(slots=True)
class _Box:
    """A node with its size and place.

    `across` is the room that it and all below it take among its neighbours.
    """

    shape: Shape
    width: float
    height: float
    children: list[_Box] = field(default_factory=list)
    across: float = 0
    x: float = 0
    y: float = 0


def render_svg(shapes: Sequence[Shape]) -> str:
    """A picture, one tree below the other."""
    parts: list[str] = []
    top, right = float(MARGIN), 0.0
    for shape in shapes:
        box = _measured(shape)
        grows_down = _sized(box, grows_down=True).across <= MAX_WIDTH
        if grows_down:
            _place_down(box, MARGIN, top)
        else:
            _place_right(_sized(box, grows_down=False), top)
        boxes = list(_all(box))
        right = max(right, *(one.x + one.width for one in boxes))
        parts.extend(part for one in boxes for part in _edges(one, grows_down))
        parts.extend(part for one in boxes for part in _drawn(one))
        top = max(one.y + one.height for one in boxes) + GAP_BELOW
    size = f"{right + MARGIN:.0f}", f"{top - GAP_BELOW + MARGIN:.0f}"
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}" height="{size[1]}" '
        f'viewBox="0 0 {size[0]} {size[1]}"><style>{STYLE}</style>'
        f'<rect width="100%" height="100%" fill="white"/>'
    )
    return "\n".join([head, *parts, "</svg>"]) + "\n"


def _all(box: _Box) -> Iterator[_Box]:
    waiting = [box]
    while waiting:
        one = waiting.pop()
        yield one
        waiting.extend(reversed(one.children))


def _measured(shape: Shape) -> _Box:
    label = (len(shape.label) + len(shape.symbol) + 1) * LABEL_WIDTH
    note = max((len(note) for note in shape.notes), default=0) * NOTE_WIDTH
    width = max(label, note, 30) + 2 * PADDING
    height = LINE + NOTE_HEIGHT * len(shape.notes) + PADDING
    return _Box(shape, width, height, [_measured(child) for child in shape.children])


def _below(box: _Box) -> float:
    """The room that the children take together."""
    return sum(child.across for child in box.children) + GAP * max(len(box.children) - 1, 0)


def _sized(box: _Box, grows_down: bool) -> _Box:
    for child in box.children:
        _sized(child, grows_down)
    box.across = max(box.width if grows_down else box.height, _below(box))
    return box


def _between(low: float, wanted: float, high: float) -> float:
    return min(max(wanted, low), high)


def _place_down(box: _Box, left: float, top: float) -> None:
    """Each box above the middle of its children, as far as there is room."""
    x = left + (box.across - _below(box)) / 2
    for child in box.children:
        _place_down(child, x, top + box.height + GAP_BELOW)
        x += child.across + GAP
    middle = left + box.across / 2
    if box.children:
        first, last = box.children[0], box.children[-1]
        middle = (first.x + first.width / 2 + last.x + last.width / 2) / 2
    room = left + box.across - box.width
    box.x, box.y = _between(left, middle - box.width / 2, room), top


def _place_right(root: _Box, top: float) -> None:
    """One column per level; each box beside the middle of its children."""
    widths: list[float] = []
    level = [root]
    while level:
        widths.append(max(box.width for box in level))
        level = [child for box in level for child in box.children]

    def place(box: _Box, x: float, above: float, depth: int) -> None:
        y = above + (box.across - _below(box)) / 2
        for child in box.children:
            place(child, x + widths[depth] + GAP_RIGHT, y, depth + 1)
            y += child.across + GAP
        middle = above + box.across / 2
        if box.children:
            first, last = box.children[0], box.children[-1]
            middle = (first.y + first.height / 2 + last.y + last.height / 2) / 2
        room = above + box.across - box.height
        box.x, box.y = x, _between(above, middle - box.height / 2, room)

    place(root, MARGIN, top, 0)


def _edges(box: _Box, grows_down: bool) -> Iterator[str]:
    for child in box.children:
        if grows_down:
            x, y = box.x + box.width / 2, box.y + box.height
            to_x, to_y = child.x + child.width / 2, child.y
            half = (y + to_y) / 2
            bends = f"{x:.1f} {half:.1f} {to_x:.1f} {half:.1f}"
        else:
            x, y = box.x + box.width, box.y + box.height / 2
            to_x, to_y = child.x, child.y + child.height / 2
            half = to_x - GAP_RIGHT / 2
            bends = f"{half:.1f} {y:.1f} {half:.1f} {to_y:.1f}"
        yield f'<path class="edge" d="M{x:.1f} {y:.1f} C{bends} {to_x:.1f} {to_y:.1f}"/>'


def _drawn(box: _Box) -> Iterator[str]:
    fill, border = COLOURS[box.shape.look]
    radius = min(box.height / 2, 16) if box.shape.look is Look.CONDITION else 5
    dashes = ' stroke-dasharray="5 3"' if box.shape.look is Look.SUBTREE else ""
    yield (
        f'<rect x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" height="{box.height:.1f}" '
        f'rx="{radius:.1f}" fill="{fill}" stroke="{border}"{dashes}/>'
    )
    middle = box.x + box.width / 2
    y = box.y + PADDING / 2 + 12
    label = escape(f"{box.shape.symbol} {box.shape.label}")
    yield f'<text x="{middle:.1f}" y="{y:.1f}">{label}</text>'
    for note in box.shape.notes:
        y += NOTE_HEIGHT
        yield f'<text class="note" x="{middle:.1f}" y="{y:.1f}">{escape(note)}</text>'
