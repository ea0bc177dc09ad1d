"""The timeline as text: a lane per robot, with blocks for its work and marks for faults.

    A1  ┣move_frame━━━✔┣┄do_diagnosis━━━✖·········
    B1      ┣look━━━━━━✔              ↳do_diagnosis━▶

Signs carry all information; colours repeat it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rich.text import Text

from mrbt_mesh.cli.views.marks import END_MARKS
from mrbt_mesh.views.terminal.team import Item, ShownTeam

# The span that is shown without a zoom, in seconds.
USUAL_S = 60.0
LEAST_S = 10.0
# The minimum number of columns between labels on the axis.
LABEL_COLUMNS = 10
LEAST_LABEL = 3
LEGEND = (
    "┣┄ claimed  ━ at work  ✔ done  ✘ failed  ┤ not needed any more  ✖ died  ↳ took over  ▾ lost  "
    "│ now  ├╌ expected  ┊ expected end"
)


@dataclass(frozen=True)
class Window:
    """The part of the run that is shown: seconds `from_s` to `to_s` in `width` columns."""

    from_s: float
    to_s: float
    width: int

    @classmethod
    def latest(cls, now_s: float, width: int) -> Window:
        """Return the whole run, or its last `USUAL_S` seconds if it is longer."""
        shown_s = min(max(now_s, LEAST_S), USUAL_S)
        from_s = max(0.0, now_s - shown_s)
        return cls(from_s, from_s + shown_s, width)

    def column(self, at_s: float) -> int:
        """Return the column of a moment; it may lie outside."""
        return math.floor((at_s - self.from_s) * self.width / (self.to_s - self.from_s))


class _Canvas:
    """One line of cells; what lies outside is not drawn."""

    def __init__(self, width: int) -> None:
        self.cells = [" "] * width
        self.styles = [""] * width

    def put(self, column: int, text: str, style: str) -> None:
        for offset, sign in enumerate(text, start=column):
            if 0 <= offset < len(self.cells):
                self.cells[offset], self.styles[offset] = sign, style

    def text(self) -> Text:
        line = Text(no_wrap=True, overflow="crop")
        for sign, style in zip(self.cells, self.styles, strict=True):
            line.append(sign, style)
        return line


def lane(shown: ShownTeam, robot: str, window: Window) -> Text:
    """Return what a robot did, in exactly `window.width` columns."""
    canvas = _Canvas(window.width)
    for work in shown.works(robot, window.from_s):
        _draw_work(canvas, work, window, shown.now_s)
    for loss in shown.losses:
        if loss["robot"] == robot and loss["at_s"] is not None:
            canvas.put(window.column(loss["at_s"]), "▾", "bold yellow")
    for fault in shown.faults:
        _draw_fault(canvas, fault, robot, window, shown.now_s)
    if shown.forecast is not None:
        _draw_forecast(canvas, shown.forecast, robot, window, shown.now_s)
    return canvas.text()


def _draw_forecast(
    canvas: _Canvas, forecast: Item, robot: str, window: Window, now_s: float
) -> None:
    """Draw what is expected, after the line that marks now."""
    at_s, known = forecast["at_s"], forecast["robots"].get(robot)
    now = window.column(now_s)
    if forecast["ends_s"] is not None:
        canvas.put(window.column(max(now_s, at_s + forecast["ends_s"])), "┊", "dim")
    if known is not None:
        spans = [(0.0, known["work_s"], "")] if known["work"] else []
        spans += [(x["begins_s"], x["ends_s"], x["local_task"]) for x in known["steps"]]
        for begins_s, ends_s, name in spans:
            start, stop = window.column(at_s + begins_s), window.column(at_s + ends_s)
            start = max(start, now + 1)
            text = ("├" if name else "╌") + name[: max(0, stop - start - 2)]
            canvas.put(start, text.ljust(stop - start, "╌"), "dim cyan")
    canvas.put(now, "│", "cyan")


def _draw_work(canvas: _Canvas, work: Item, window: Window, now_s: float) -> None:
    if work["claimed_s"] is None:
        return
    ended_s, running_s = (_until(work[name], now_s) for name in ("ended_s", "running_s"))
    width = window.width
    start = window.column(work["claimed_s"])
    stop = max(start + 1, window.column(now_s if ended_s is None else ended_s))
    running = stop if running_s is None else window.column(running_s)
    sign, style = "━", "red"
    if ended_s is None:
        sign, style = ("▶", "bold cyan") if running_s is not None else ("┄", "cyan")
    elif work["end"] in END_MARKS:
        sign, style = END_MARKS[work["end"]]
    first, last = max(start, 0), min(stop, width)
    for column in range(first, last):
        canvas.put(column, "━" if column >= running else "┄", style)
    canvas.put(start, "┣", style)
    room = last - first - 2
    if room >= LEAST_LABEL:
        name = work["local_task"]
        canvas.put(first + 1, name if len(name) <= room else name[: room - 1] + "…", style)
    canvas.put(stop - 1, sign, style)


def _draw_fault(canvas: _Canvas, fault: Item, robot: str, window: Window, now_s: float) -> None:
    at_s = fault["at_s"]
    if at_s is None:
        return
    if fault["replacement"] == robot and fault["taken_over_ms"] is not None:
        canvas.put(window.column(at_s + fault["taken_over_ms"] / 1e3), "↳", "bold yellow")
    if fault["robot"] == robot:
        until_s = _until(fault["until_s"], now_s)
        died, until = window.column(at_s), window.column(now_s if until_s is None else until_s)
        for column in range(max(died, 0), min(until, window.width)):
            if canvas.cells[column] == " ":
                canvas.put(column, "·", "red")
        canvas.put(died, "✖", "bold red")


def _until(at_s: float | None, now_s: float) -> float | None:
    """Return a time if it has passed; a recording also has later ones."""
    return at_s if at_s is not None and at_s <= now_s else None


def axis(window: Window) -> Text:
    """Return the seconds below the lanes."""
    canvas = _Canvas(window.width)
    step_s = _step_s((window.to_s - window.from_s) * LABEL_COLUMNS / max(window.width, 1))
    number = math.ceil(window.from_s / step_s)
    while number * step_s <= window.to_s:
        canvas.put(window.column(number * step_s), f"╵{number * step_s:g} s", "dim")
        number += 1
    return canvas.text()


def _step_s(least_s: float) -> float:
    """Return the smallest of 1, 2, 5, 10, 20, 50, .. (also below 1) that is not below `least_s`."""
    power = 10.0 ** math.floor(math.log10(least_s))
    return next(power * factor for factor in (1, 2, 5, 10) if power * factor >= least_s * 0.999)


def latest_fault(shown: ShownTeam) -> str:
    """Describe the latest death in a few words: its time, its detection, and the takeover."""
    if not shown.faults:
        return ""
    fault = shown.faults[-1]
    text = f"✖ {fault['robot']} at {fault['at_s'] or 0.0:.1f} s"
    if fault["detected_after"] is not None:
        text += f": detected after {fault['detected_after']}"
    if fault["taken_over_after"] is not None:
        text += f", {fault['replacement']} took over after {fault['taken_over_after']}"
    return text
