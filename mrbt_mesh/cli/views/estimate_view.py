"""Success, durations and curves of many runs, for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.sim.estimate import PERCENTILES, Summary
from mrbt_mesh.sim.statistics.team_sizes import describe, resized


def render_estimate(
    mission: Mission, summaries: Sequence[Summary], runs: int, took_s: float, jobs: int
) -> RenderableType:
    """All that the runs say: a table of settings, or one setting in detail."""
    where = f"{jobs} processes" if jobs > 1 else "one process"
    text = f"{runs} runs in {took_s:.1f} s in {where}, {60 * runs / took_s:.0f} a minute"
    team = describe(mission.robots)
    size = summaries[0].point.robots
    if size is not None and "robots" not in dict(summaries[0].point.values):
        team = describe(resized(mission, size).robots)
    head = Text.assemble((mission.name, "bold"), f"  {team}  ", (text, "dim"))
    if summaries[0].point.values:
        return Group(head, _settings(summaries))
    return Group(head, *_one_setting(summaries[0]))


def _settings(summaries: Sequence[Summary]) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    names = [name for name, _ in summaries[0].point.values]
    for name in (*names, "success", "", "95 % interval", "mean s", "p5", "median", "p95"):
        table.add_column(name, justify="left" if name == "" else "right", no_wrap=True)
    series = None
    for summary in summaries:
        values = dict(summary.point.values)
        low, high = summary.interval
        if series not in (None, summary.point.values[1:]):
            table.add_row()
        series = summary.point.values[1:]
        table.add_row(
            *(values[name] for name in names),
            f"{summary.probability:.1%}",
            f"[cyan]{_bar(summary.probability, 10):10}[/]",
            f"{low * 100:.1f} to {high * 100:.1f}",
            _seconds(summary.mean_s),
            *(_seconds(summary.percentile_s(percent)) for percent in (5, 50, 95)),
        )
    return table


def _one_setting(summary: Summary) -> Iterator[RenderableType]:
    low, high = summary.interval
    results = ", ".join(f"{count} {name}" for name, count in summary.results.items())
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(style="dim")
    table.add_column()
    share = f"[bold]{summary.probability:.1%}[/]  ({low:.1%} to {high:.1%} with 95 % confidence)"
    table.add_row("success", share)
    table.add_row("results", results)
    faults = f"{summary.major_faults:.2f} major and {summary.minor_faults:.2f} minor faults a run"
    table.add_row("faults", faults)
    if summary.durations_s:
        parts = [f"p{p} {_seconds(summary.percentile_s(p))}" for p in PERCENTILES]
        figures = ", ".join(parts)
        table.add_row("duration", f"[bold]{_seconds(summary.mean_s)} s[/] mean; {figures}")
    yield table
    yield from _histogram(summary)
    if len(summary.by_faults) > 1:
        yield Text("\nby the faults that befell a run", "dim")
        yield _by_faults(summary)


def _histogram(summary: Summary) -> Iterator[Text]:
    edges, counts = summary.histogram(12)
    if not counts or edges[-1] - edges[0] < 1e-3:
        return
    most = max(counts)
    yield Text("\nduration of successful runs, s", "dim")
    for number, count in enumerate(counts):
        span = f"{edges[number]:8.2f} to {edges[number + 1]:<8.2f}"
        yield Text.assemble(span, " ", (_bar(count / most, 40), "cyan"), f" {count}")


def _by_faults(summary: Summary) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for name in ("major", "minor", "runs", "success", "mean s"):
        table.add_column(name, justify="right")
    for (major, minor), (runs, successes, mean_s) in summary.by_faults.items():
        mean = _seconds(mean_s) if successes else "-"
        table.add_row(str(major), str(minor), str(runs), f"{successes / runs:.1%}", mean)
    return table


def _bar(share: float, width: int) -> str:
    eighths = round(share * width * 8)
    full, rest = divmod(eighths, 8)
    return "█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
