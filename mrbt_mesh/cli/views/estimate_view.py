"""Success and durations of many runs, for a terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from mrbt_mesh.cli.printing import Printable, Stack, Styled, Table
from mrbt_mesh.cli.terminal import table
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.sim.estimate import PERCENTILES, Summary


def render_estimate(mission: Mission, summary: Summary, took_s: float, jobs: int) -> Stack:
    """How often the mission succeeded, how long it took, and by which faults."""
    where = f"{jobs} processes" if jobs > 1 else "one process"
    text = f"{summary.runs} runs in {took_s:.1f} s in {where}, {60 * summary.runs / took_s:.0f}"
    types = Counter(robot.type for robot in mission.robots.values())
    team = ", ".join(f"{count} {kind}" for kind, count in sorted(types.items()))
    head = Styled.assemble((mission.name, "bold"), f"  {team}  ", (f"{text} a minute", "dim"))
    return Stack(head, *_parts(summary))


def _parts(summary: Summary) -> Iterator[Printable]:
    low, high = summary.interval
    results = ", ".join(f"{count} {name}" for name, count in summary.results.items())
    rows = Table(("", ""), first_style="dim")
    between = f"  ({low:.1%} to {high:.1%} with 95 % confidence)"
    rows.add_row("success", Styled.assemble((f"{summary.probability:.1%}", "bold"), between))
    rows.add_row("results", results)
    faults = f"{summary.major_faults:.2f} major and {summary.minor_faults:.2f} minor faults a run"
    rows.add_row("faults", faults)
    if summary.durations_s:
        parts = [f"p{p} {_seconds(summary.percentile_s(p))}" for p in PERCENTILES]
        figures = ", ".join(parts)
        mean = (f"{_seconds(summary.mean_s)} s", "bold")
        rows.add_row("duration", Styled.assemble(mean, f" mean; {figures}"))
    yield rows
    yield from _histogram(summary)
    if len(summary.by_faults) > 1:
        yield Styled("\nby the faults that befell a run", "dim")
        yield _by_faults(summary)


def _histogram(summary: Summary) -> Iterator[Styled]:
    edges, counts = summary.histogram(12)
    if not counts or edges[-1] - edges[0] < 1e-3:
        return
    most = max(counts)
    yield Styled("\nduration of successful runs, s", "dim")
    for number, count in enumerate(counts):
        span = f"{edges[number]:8.2f} to {edges[number + 1]:<8.2f}"
        yield Styled.assemble(span, " ", (_bar(count / most, 40), "cyan"), f" {count}")


def _by_faults(summary: Summary) -> Table:
    rows = table("major", "minor", "runs", "success", "mean s", right=range(5))
    for (major, minor), (runs, successes, mean_s) in summary.by_faults.items():
        mean = _seconds(mean_s) if successes else "-"
        rows.add_row(str(major), str(minor), str(runs), f"{successes / runs:.1%}", mean)
    return rows


def _bar(share: float, width: int) -> str:
    eighths = round(share * width * 8)
    full, rest = divmod(eighths, 8)
    return "█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
