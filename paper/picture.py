"""A scene as an SVG: the vehicle from above, its parts, and the robots where they work.

Only integers and texts go in, in a fixed order: the same scene gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from mrbt_mesh.core.mission.names import type_name
from paper.scene import Cover, Part, Scene, Screws

WIDTH, HEIGHT = 936, 560
PART, COLUMN, IN_A_ROW = 50, 90, 3
BAY_LEFT, BAY_TOP, BAY_WIDTH, BAY_HEIGHT = 92, 146, 282, 158
ROWS = (187, 263)
SIDES = (88, 362)
"""Where robots stand: the y of those above the vehicle, and of those below it."""
APART = 40
RESTING_LEFT, RESTING_Y = 122, 444
COVER_AWAY = 530
"""How far to the right of the bay the cover lies when it is off."""

SIGNS = {
    Part.UNKNOWN: "",
    Part.IN_ORDER: "M-6 0 L-2 5 L7 -5",
    Part.BROKEN: "M-5 -5 L5 5 M5 -5 L-5 5",
    Part.REPAIRED: "M-6 0 L-2 5 L7 -5",
}

STYLE = """
text { font: 14px system-ui, "Segoe UI", Helvetica, Arial, sans-serif; fill: #1f2430 }
.title { font-size: 19px; font-weight: 600 } .small { font-size: 12px; fill: #5b6375 }
.name { font-size: 13px; font-weight: 700; fill: #fff; text-anchor: middle }
.task { font-size: 12px; text-anchor: middle }
.ground { fill: #f4f5f8; stroke: #d5d9e2 } .strip { fill: #e6e9f0 }
.body { fill: #c3cad8; stroke: #77819a; stroke-width: 2 }
.glass { fill: #8fa5bf } .roof { fill: #b2bbcc } .wheel { fill: #2b303c } .lamp { fill: #fff3c4 }
.bay { fill: #343b4b; stroke: #77819a; stroke-width: 2 }
.cover { fill: #dfe4ee; fill-opacity: .4; stroke: #77819a; stroke-width: 2 }
.aside { fill-opacity: 1 } .ghost { fill: none; stroke: #77819a; stroke-dasharray: 6 5 }
.screw { fill: #f0f2f7; stroke: #343b4b; stroke-width: 1.5 }
.hole { fill: #1f2430; stroke: #77819a }
.way { fill: none; stroke: #77819a; stroke-width: 3; stroke-linecap: round }
.unknown { fill: #8b93a3 } .good { fill: #2a8a4a } .broken { fill: #c9302c }
.sign { fill: none; stroke: #fff; stroke-width: 2.5; stroke-linecap: round }
.arm { stroke-width: 5; stroke-linecap: round; stroke-opacity: .75 }
.A { fill: #2166c2; stroke: #2166c2 } .B { fill: #b35900; stroke: #b35900 }
.C { fill: #7d3fa8; stroke: #7d3fa8 } .rim { stroke: #fff; stroke-width: 2 }
.gone { fill: #6d7483 } .crossed { stroke: #c9302c; stroke-width: 5; stroke-linecap: round }
@media (prefers-color-scheme: dark) {
text { fill: #e7eaf1 } .small { fill: #a6aebf } .name { fill: #fff }
.ground { fill: #171b24; stroke: #39404f } .strip { fill: #222834 }
.body { fill: #4a5468; stroke: #8d98b0 } .glass { fill: #2c3a4e } .roof { fill: #5a6479 }
.wheel { fill: #05070b } .bay { fill: #0e121a; stroke: #8d98b0 }
.cover { fill: #7f8aa1; stroke: #a6b0c5 } .ghost { fill: none }
.arm { stroke-opacity: 1 }
}
"""

Point = tuple[int, int]
VEHICLE = f"""\
<rect class="wheel" x="104" y="116" width="76" height="26" rx="8"/>
<rect class="wheel" x="104" y="308" width="76" height="26" rx="8"/>
<rect class="wheel" x="440" y="116" width="76" height="26" rx="8"/>
<rect class="wheel" x="440" y="308" width="76" height="26" rx="8"/>
<path class="body" d="M96 122 H540 Q584 122 586 166 V284 Q584 328 540 328 H96 \
Q42 318 40 262 V188 Q42 132 96 122 Z"/>
<path class="lamp" d="M52 158 Q60 140 74 136 L78 150 Q64 156 60 170 Z"/>
<path class="lamp" d="M52 292 Q60 310 74 314 L78 300 Q64 294 60 280 Z"/>
<path class="glass" d="M386 146 Q398 140 420 152 V298 Q398 310 386 304 Q396 225 386 146 Z"/>
<rect class="roof" x="424" y="148" width="100" height="154" rx="10"/>
<path class="glass" d="M528 152 L556 142 Q566 225 556 308 L528 298 Z"/>
<rect class="bay" x="{BAY_LEFT}" y="{BAY_TOP}" width="{BAY_WIDTH}" height="{BAY_HEIGHT}" rx="8"/>"""


def draw(scene: Scene, title: str, caption: Sequence[str]) -> str:
    """The SVG document; `caption` are the lines below the picture."""
    shown = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" height="{HEIGHT}" role="img">',
        f"<title>{escape(title)}</title>",
        f"<desc>{escape(' '.join(caption))}</desc>",
        f"<style>{STYLE}</style>",
        f'<rect class="ground" x="1" y="1" width="{WIDTH - 2}" height="{HEIGHT - 2}" rx="10"/>',
        f'<text class="title" x="24" y="36">{escape(title)}</text>',
        VEHICLE,
        *(line for part in scene.parts for line in _part(scene, part)),
        *_cover(scene),
        *_screws(scene),
        *_robots(scene),
        *_key(),
    ]
    for number, line in enumerate(caption):
        shown.append(f'<text x="24" y="{HEIGHT - 66 + 24 * number}">{escape(line)}</text>')
    return "\n".join([*shown, "</svg>", ""])


def place(scene: Scene, part: str) -> Point:
    """The centre of a part in the bay."""
    row, column = divmod(list(scene.parts).index(part), IN_A_ROW)
    return BAY_LEFT + 51 + COLUMN * column, ROWS[row]


def positions(scene: Scene) -> dict[str, Point]:
    """The place of each robot that has joined."""
    found: dict[str, Point] = {}
    for part in scene.parts:
        x, y = place(scene, part)
        side = SIDES[y != ROWS[0]]
        there = sorted(robot for robot, span in scene.work.items() if span.part == part)
        there += sorted(robot for robot in scene.dead if scene.last.get(robot) == part)
        for number, robot in enumerate(there):
            # The dead stand behind those who work; they do not move them out of the middle.
            living = max(1, sum(other in scene.work for other in there))
            found[robot] = (x + APART * number - APART * (living - 1) // 2, side)
    at_the_cover = sorted(r for r, span in scene.work.items() if not span.part)
    for number, robot in enumerate(at_the_cover):
        found[robot] = _at_the_cover(scene, number)
    others = (r for r in scene.team if r in scene.joined and r not in found)
    for number, robot in enumerate(others):
        found[robot] = (RESTING_LEFT + 54 * number, RESTING_Y)
    return found


def _at_the_cover(scene: Scene, number: int) -> Point:
    if scene.cover in (Cover.GOING_OFF, Cover.GOING_ON):
        middle = _cover_left(scene) + BAY_WIDTH // 2
        return middle + 60 * (number // 2), SIDES[number % 2]
    corners = ((0, 0), (1, 1), (1, 0), (0, 1))
    across, down = corners[number % len(corners)]
    return BAY_LEFT + BAY_WIDTH * across, SIDES[down]


def _cover_left(scene: Scene) -> int:
    moving = scene.cover in (Cover.GOING_OFF, Cover.GOING_ON)
    return BAY_LEFT + (COVER_AWAY // 4 if moving else COVER_AWAY * (scene.cover is Cover.OFF))


def _part(scene: Scene, part: str) -> list[str]:
    x, y = place(scene, part)
    state = scene.parts[part]
    colour = {Part.UNKNOWN: "unknown", Part.BROKEN: "broken"}.get(state, "good")
    half = PART // 2
    lines = [
        f'<rect class="part {colour}" id="part{escape(part)}" x="{x - half}" y="{y - half}" '
        f'width="{PART}" height="{PART}" rx="10"/>',
        f'<text class="name" x="{x}" y="{y + (-2 if SIGNS[state] else 5)}">{escape(part)}</text>',
    ]
    if SIGNS[state]:
        path = f'<path class="sign" transform="translate({x} {y + 12})" d="{SIGNS[state]}"/>'
        lines.append(path)
    return lines


def _cover(scene: Scene) -> list[str]:
    left = _cover_left(scene)
    box = f'y="{BAY_TOP}" width="{BAY_WIDTH}" height="{BAY_HEIGHT}" rx="8"'
    classes = "cover aside" if scene.cover is Cover.OFF else "cover"
    lines = [f'<rect class="{classes}" id="cover" x="{left}" {box}/>']
    if scene.cover is not Cover.OFF:
        lines.append(f'<rect class="ghost" x="{BAY_LEFT + COVER_AWAY}" {box}/>')
    if scene.cover in (Cover.GOING_OFF, Cover.GOING_ON):
        x, y = left + BAY_WIDTH - 60, BAY_TOP + BAY_HEIGHT // 2
        along = 1 if scene.cover is Cover.GOING_OFF else -1
        way = f"M{x - 22} {y} H{x + 22} M{x + 10 * along} {y - 10} L{x + 22 * along} {y} "
        lines.append(f'<path class="way" d="{way}L{x + 10 * along} {y + 10}"/>')
    label = f"cover: {scene.cover}; screws: {scene.screws}"
    middle = BAY_LEFT + COVER_AWAY + BAY_WIDTH // 2
    lines.append(f'<text class="task" x="{middle}" y="{BAY_TOP - 14}">{label}</text>')
    return lines


def _screws(scene: Scene) -> list[str]:
    classes = "screw" if scene.screws is not Screws.OUT else "hole"
    return [
        f'<circle class="{classes}" cx="{x}" cy="{y}" r="5"/>'
        for x in (BAY_LEFT + 9, BAY_LEFT + BAY_WIDTH - 9)
        for y in (BAY_TOP + 9, BAY_TOP + BAY_HEIGHT - 9)
    ]


# -- robots -----------------------------------------------------------------------------------


def _robots(scene: Scene) -> list[str]:
    where = positions(scene)
    lines = [
        f'<rect class="strip" x="24" y="{RESTING_Y - 28}" width="420" height="56" rx="8"/>',
        f'<text class="small" x="40" y="{RESTING_Y + 4}">at rest</text>',
    ]
    for robot in sorted(scene.work):
        lines.append(_arm(scene, robot, where[robot]))
    for robot in sorted(where):
        lines += _robot(scene, robot, where[robot])
    return lines + _labels(scene, where)


def _arm(scene: Scene, robot: str, position: Point) -> str:
    """From the robot to what it works on."""
    x, y = position
    part = scene.work[robot].part
    if part:
        target_x, middle = place(scene, part)
        reach = PART // 2 - 4
        target_y = middle + (-reach if y < middle else reach)
    else:
        target_x = x
        target_y = BAY_TOP + 9 if y < BAY_TOP else BAY_TOP + BAY_HEIGHT - 9
        if scene.work[robot].local_task == "use_screwdriver":
            target_x += 9 if x == BAY_LEFT else -9
    kind = escape(scene.team[robot])
    return f'<line class="arm {kind}" x1="{x}" y1="{y}" x2="{target_x}" y2="{target_y}"/>'


def _robot(scene: Scene, robot: str, position: Point) -> list[str]:
    """A is a circle, B a hexagon, C a big square: they differ in more than their colours."""
    x, y = position
    kind = scene.team[robot]
    classes = "gone rim" if robot in scene.dead else f"{escape(kind)} rim"
    if kind == "A":
        shape = f'<circle class="{classes}" cx="{x}" cy="{y}" r="18"/>'
    elif kind == "B":
        corners = ((-19, 0), (-10, -17), (10, -17), (19, 0), (10, 17), (-10, 17))
        points = " ".join(f"{x + dx},{y + dy}" for dx, dy in corners)
        shape = f'<polygon class="{classes}" points="{points}"/>'
    else:
        shape = f'<rect class="{classes}" x="{x - 22}" y="{y - 22}" width="44" height="44" rx="9"/>'
    lines = [f'<g class="robot" id="{escape(robot)}">', shape]
    if robot not in scene.dead:
        lines.append(f'<text class="name" x="{x}" y="{y + 5}">{escape(robot)}</text>')
    else:
        cross = f"M{x - 17} {y - 17} L{x + 17} {y + 17} M{x + 17} {y - 17} L{x - 17} {y + 17}"
        lines.append(f'<path class="crossed" d="{cross}"/>')
        lines.append(f'<text class="small" x="{x + 24}" y="{y + 4}">{escape(robot)} is dead</text>')
    return [*lines, "</g>"]


def _labels(scene: Scene, where: dict[str, Point]) -> list[str]:
    """Once for all robots that do the same to the same part: what it is."""
    groups: dict[tuple[str, int], list[int]] = {}
    for robot in sorted(scene.work):
        x, y = where[robot]
        span = scene.work[robot]
        text = type_name(span.local_task)
        # At the cover each robot has a label of its own.
        apart = 0 if span.part else x
        groups.setdefault((f"{text}|{span.part}|{apart}", y), []).append(x)
    lines = []
    for (group, y), places in groups.items():
        text, x = group.partition("|")[0], sum(places) // len(places)
        below = y + 36 if y > BAY_TOP else y - 28
        lines.append(f'<text class="task" x="{x}" y="{below}">{escape(text)}</text>')
    return lines


def _key() -> list[str]:
    """What the colours of the parts mean."""
    lines = []
    meanings = (("unknown", "not diagnosed"), ("good", "in order"), ("broken", "broken"))
    for number, (colour, text) in enumerate(meanings):
        x, y = 560 + 124 * number, RESTING_Y
        lines.append(
            f'<rect class="{colour}" x="{x}" y="{y - 9}" width="18" height="18" rx="4"/>'
            f'<text class="small" x="{x + 25}" y="{y + 4}">{text}</text>'
        )
    return lines
