"""Charts of what benchmarks found, in the style of mrbt_mesh/sim/plotting.py."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.registry import Chart, MissingPackageError

SIZE_INCHES = (6.4, 4.2)
DOTS_PER_INCH = 150
MARKERS = "osD^v<>Ph*"


def draw(charts: Sequence[Chart], folder: Path) -> list[Path]:
    """Write one .png per chart; returns the files. Raises MissingPackageError, OSError."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingPackageError("--plot needs matplotlib: pip install -e '.[plot]'") from None
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for chart in charts:
        figure = Figure(figsize=SIZE_INCHES, layout="constrained")
        axes = figure.subplots()
        for index, (label, points) in enumerate(chart.curves.items()):
            x, y = zip(*sorted(points), strict=True)
            axes.plot(
                x, y, marker=MARKERS[index % len(MARKERS)], markersize=4, linewidth=1.2, label=label
            )
        if chart.log:
            axes.set_xscale("log")
            axes.set_yscale("log")
        axes.set_title(chart.title, fontsize="medium")
        axes.set_xlabel(chart.x_label)
        axes.set_ylabel(chart.y_label)
        axes.grid(alpha=0.3)
        if len(chart.curves) > 1:
            axes.legend(fontsize="small")
        files.append(folder / f"{chart.name}.png")
        figure.savefig(files[-1], dpi=DOTS_PER_INCH)
    return files
