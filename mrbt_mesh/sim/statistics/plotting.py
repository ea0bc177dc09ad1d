"""Pictures of what an experiment showed; the only place that needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mrbt_mesh.errors import InputError
from mrbt_mesh.sim.estimate import Summary, percentile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE_INCHES = (10.0, 4.2)
DOTS_PER_INCH = 150
LABELS = {
    "major": "major faults",
    "minor": "minor faults",
    "robots": "robots",
    "fault-rate": "chance of a major fault",
    "minor-rate": "chance of a minor fault",
    "failure-rate": "chance that an action fails",
}
COUNTS = ("major", "minor", "robots")


class PlotError(InputError):
    """A picture that cannot be made; the message says why."""


def check_picture(path: Path) -> None:
    """Raise PlotError, before any run is made, if no picture can be drawn or not of this kind."""
    figure = _figure()
    kinds = figure.canvas.get_supported_filetypes()
    if path.suffix.removeprefix(".").lower() not in kinds:
        listed = ", ".join(f".{kind}" for kind in sorted(kinds))
        raise PlotError(f"{path}: no kind of picture is known by that ending ({listed})")


def _figure() -> Figure:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise PlotError("--plot needs matplotlib: pip install 'mrbt-mesh[plot]'") from None
    return Figure(figsize=SIZE_INCHES, layout="constrained")


def plot(summaries: Sequence[Summary], title: str, path: Path) -> None:
    """Write a picture, of the kind that the file's name says (.png, .svg, .pdf).

    Without a sweep a histogram of durations; with one, success and duration over its values;
    with two, a curve for each value of the second. Raises PlotError.
    """
    figure = _figure()
    figure.suptitle(title)
    if summaries[0].point.values:
        success, duration = figure.subplots(1, 2)
        _curves(summaries, success, duration)
    else:
        _histogram(summaries[0], figure.subplots())
    try:
        figure.savefig(path, dpi=DOTS_PER_INCH)
    except (OSError, ValueError) as error:
        raise PlotError(f"{path}: cannot be written: {error}") from None


def _histogram(summary: Summary, axes: Axes) -> None:
    edges, counts = summary.histogram()
    if counts:
        axes.stairs(counts, edges, fill=True, color="tab:blue", alpha=0.7)
        axes.axvline(summary.mean_s or 0.0, color="black", linewidth=1, label="mean")
        median = summary.percentile_s(50) or 0.0
        axes.axvline(median, color="black", linewidth=1, linestyle="--", label="median")
        axes.legend()
    low, high = summary.interval
    text = f"success {summary.probability:.1%} ({low:.1%} to {high:.1%}), {summary.runs} runs"
    axes.set_title(text, fontsize="medium")
    axes.set_xlabel("duration of successful runs, s")
    axes.set_ylabel("runs")


def _curves(summaries: Sequence[Summary], success: Axes, duration: Axes) -> None:
    names = [name for name, _ in summaries[0].point.values]
    curves: dict[str, list[Summary]] = {}
    for summary in summaries:
        series = "".join(f"{value} {LABELS[name]}" for name, value in summary.point.values[1:])
        curves.setdefault(series, []).append(summary)
    for series, points in curves.items():
        _curve(series, points, success, duration)
    success.set_ylabel("probability of success")
    success.set_ylim(-0.03, 1.03)
    duration.set_ylabel("duration of successful runs, s")
    duration.set_ylim(0, duration.get_ylim()[1] * 1.05)
    success.set_title("with 95 % confidence interval", fontsize="medium")
    duration.set_title("median, and 5th to 95th percentile", fontsize="medium")
    values = {summary.point.values[0][1] for summary in summaries}
    unit = next(iter(values)).partition("/")[2]
    for axes in (success, duration):
        axes.set_xlabel(LABELS[names[0]] + (f", per {unit}" if unit else ""))
        if names[0] in COUNTS:
            axes.set_xticks(sorted({number_of(value) for value in values}))
        axes.grid(alpha=0.3)
    if len(curves) > 1:
        duration.legend(fontsize="small", loc="lower right")


def _curve(series: str, points: Sequence[Summary], success: Axes, duration: Axes) -> None:
    """One curve in both, with bars for what is uncertain."""
    for axes, curve in ((success, _success), (duration, _duration)):
        shown = points if axes is success else [s for s in points if s.successes]
        found = [(number_of(s.point.values[0][1]), *curve(s)) for s in shown]
        at = [number for number, *_ in found]
        middle = [value for _, _, value, _ in found]
        below = [value - low for _, low, value, _ in found]
        above = [high - value for _, _, value, high in found]
        axes.errorbar(
            at, middle, yerr=(below, above), marker="o", markersize=4, capsize=3, label=series
        )


def _success(summary: Summary) -> tuple[float, float, float]:
    low, high = summary.interval
    return min(low, summary.probability), summary.probability, max(high, summary.probability)


def _duration(summary: Summary) -> tuple[float, float, float]:
    low, middle, high = (percentile(summary.durations_s, percent) for percent in (5, 50, 95))
    return low, middle, high


def number_of(value: str) -> float:
    """The number of a swept value such as `0.1/hour`."""
    return float(value.partition("/")[0])
