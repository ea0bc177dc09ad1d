"""A run as a Gantt chart in SVG: a lane for each robot, faults, detection and takeover."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from mrbt_mesh.observer.episodes import after_text, lost_text
from mrbt_mesh.views.report.model import ReportedFault, ReportedWork, RunReport

LEFT, WIDTH, LANE, BAR, TOP = 74, 1000, 30, 20, 26
# Text is 11 px high; a letter takes about so much.
LETTER = 6.7
HUES = 8
ENDS = {"failed": "✘ failed", "died": "✝ died with its robot", "dropped": "┤ not needed any more"}
_STEPS = (1, 2, 5)


def gantt(run: RunReport) -> str:
    """The chart; empty if no work is known."""
    if not run.work or run.duration_s <= 0:
        return ""
    return _Gantt(run).svg()


def kinds(run: RunReport) -> list[str]:
    """The local tasks of a run without their arguments, in the order of their first work."""
    return list(dict.fromkeys(_kind(work.local_task) for work in run.work or ()))


def ticks(duration_s: float, most: int = 10) -> list[float]:
    """Round times from 0 to the end, at most `most` + 1."""
    unit = 0.001
    while True:
        for step in _STEPS:
            if duration_s / (step * unit) <= most:
                count = int(duration_s / (step * unit) + 1e-9)
                return [round(step * unit * number, 6) for number in range(count + 1)]
        unit *= 10


def _kind(local_task: str) -> str:
    return local_task.partition("(")[0]


class _Gantt:
    def __init__(self, run: RunReport) -> None:
        self.run = run
        self.robots = [each.robot for each in run.robots]
        self.hues = {kind: number % HUES for number, kind in enumerate(kinds(run))}
        self.height = TOP + LANE * len(self.robots) + 4

    def svg(self) -> str:
        parts = [*self._grid(), *self._works(), *self._faults()]
        label = f"Gantt chart of {self.run.title}: who worked on what when"
        return (
            f'<svg class="gantt" role="img" aria-label="{escape(label)}" '
            f'viewBox="0 0 {WIDTH} {self.height}">\n' + "\n".join(parts) + "\n</svg>"
        )

    def _x(self, at_s: float) -> float:
        share = min(1.0, max(0.0, at_s / self.run.duration_s))
        return round(LEFT + share * (WIDTH - LEFT - 8), 2)

    def _y(self, robot: str) -> int:
        return TOP + LANE * self.robots.index(robot)

    def _grid(self) -> Iterator[str]:
        for at_s in ticks(self.run.duration_s):
            x = self._x(at_s)
            yield f'<line class="grid" x1="{x}" x2="{x}" y1="{TOP - 4}" y2="{self.height}"/>'
            anchor = "end" if x > WIDTH - 30 else "middle"
            yield f'<text class="tick" x="{x}" y="14" text-anchor="{anchor}">{at_s:g} s</text>'
        for robot in self.robots:
            y = self._y(robot)
            yield f'<line class="lane" x1="0" x2="{WIDTH}" y1="{y + LANE}" y2="{y + LANE}"/>'
            name = robot if len(robot) <= 10 else robot[:9] + "…"
            yield f'<text class="robot" x="2" y="{y + 20}">{escape(name)}</text>'

    def _works(self) -> Iterator[str]:
        for work in self.run.work or ():
            if work.robot in self.robots:
                yield self._work(work)

    def _work(self, work: ReportedWork) -> str:
        y = self._y(work.robot) + (LANE - BAR) // 2
        x, end = self._x(work.from_s), self._x(work.to_s)
        begin = end if work.running_s is None else self._x(work.running_s)
        hue = self.hues[_kind(work.local_task)]
        how = ENDS.get(work.end or "", work.end or "not over")
        title = f"{work.robot}: {work.local_task} for {work.global_task}, {_span(work)}, {how}"
        parts = [f"<g><title>{escape(title)}</title>"]
        if begin - x >= 0.3:
            parts.append(_rect("starting", x, y + 6, begin - x, BAR - 12))
        if work.running_s is not None:
            width = max(1.5, end - begin)
            parts.append(_rect(f"work h{hue} {work.end or 'open'}", begin, y, width, BAR))
            sign = ENDS[work.end][0] if work.end in ENDS else ""
            room = int((width - 8) / LETTER) - 2 * bool(sign)
            text = work.local_task if len(work.local_task) <= room else ""
            if not text and room >= 4:
                text = work.local_task[: room - 1] + "…"
            if text:
                parts.append(
                    f'<text class="on" x="{begin + 4:g}" y="{y + 14}">{escape(text)}</text>'
                )
            if sign and width >= 12:
                mark = f'<text class="on end" x="{end - 4:g}" y="{y + 14}">{sign}</text>'
                parts.append(mark)
        return "".join(parts) + "</g>"

    def _faults(self) -> Iterator[str]:
        for fault in self.run.faults:
            if fault.robot in self.robots:
                yield self._lost(fault) if fault.lost else self._death(fault)

    def _lost(self, fault: ReportedFault) -> str:
        x, y = self._x(fault.at_s), self._y(fault.robot)
        title = f"{fault.robot} {lost_text(fault.lost, fault.reason)}, at {fault.at_s:.3f} s"
        d = f"M{x} {y + 1}l5 9h-10z"
        return f'<g><title>{escape(title)}</title><path class="minor" d="{d}"/></g>'

    def _death(self, fault: ReportedFault) -> str:
        x, y = self._x(fault.at_s), self._y(fault.robot)
        until = self._x(self.run.duration_s if fault.until_s is None else fault.until_s)
        title = f"{fault.robot} died at {fault.at_s:.3f} s"
        parts = [_rect("away", x, y + 1, max(0.0, until - x), LANE - 2)]
        for name, after_us in (
            ("detected", fault.detected_us),
            ("taken over", fault.taken_over_us),
        ):
            if after_us is not None:
                title += f", {name} after {after_text(after_us, fault.exact)}"
        if fault.detected_us is not None:
            end = self._x(fault.at_s + fault.detected_us / 1e6)
            parts.append(_rect("detection", x, y + 1, end - x, 3))
        if fault.replacement in self.robots:
            after_s = (fault.taken_over_us or 0) / 1e6
            to_x, to_y = self._x(fault.at_s + after_s), self._y(fault.replacement)
            title += f" by {fault.replacement}"
            if fault.detected_us is not None:
                begin = self._x(fault.at_s + fault.detected_us / 1e6)
                parts.append(_rect("takeover", begin, y + 1, max(0.0, to_x - begin), 3))
            parts.append(_arrow(x, y + LANE // 2, to_x, to_y + LANE // 2))
        parts.append(f'<line class="death" x1="{x}" x2="{x}" y1="{y + 1}" y2="{y + LANE - 1}"/>')
        label = f"✝ {fault.at_s:.1f} s"
        if fault.taken_over_us is not None:
            label += f", taken over after {after_text(fault.taken_over_us, fault.exact)}"
        if until - x > len(label) * LETTER + 10:
            parts.append(f'<text class="dead" x="{x + 6}" y="{y + 19}">{escape(label)}</text>')
        return f"<g><title>{escape(title)}</title>{''.join(parts)}</g>"


def _arrow(x: float, y: float, to_x: float, to_y: float) -> str:
    bend = min(26.0, abs(to_y - y) / 2)
    curve = f"M{x} {y}C{x - bend:g} {y} {to_x - bend:g} {to_y} {to_x - 2:g} {to_y}"
    head = f"M{to_x:g} {to_y}l-7 -4v8z"
    return f'<path class="hand" d="{curve}"/><path class="head" d="{head}"/>'


def _span(work: ReportedWork) -> str:
    begin = work.from_s if work.running_s is None else work.running_s
    verb = "claimed" if work.running_s is None else "running"
    return f"{verb} {begin:.3f} to {work.to_s:.3f} s"


def _rect(kind: str, x: float, y: float, width: float, height: float) -> str:
    size = f'width="{width:.2f}" height="{height:g}"'
    return f'<rect class="{kind}" x="{x:g}" y="{y:g}" {size} rx="2"/>'
