"""How often a team reaches its goal although robots die of their work, against MRBTP.

    python -m benchmarks.robustness [--runs 500] [--jobs 2] [--json FILE] [--write-docs]

Robots open four rooms and move four packages; each of them dies with some probability whenever it
completes an action. docs/explanation/robustness.md describes the experiment and the columns.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from benchmarks.report import CORES, ROOT, in_processes, run_program
from benchmarks.robustness.draws import CELLS, Cell
from benchmarks.robustness.results import Judged, judge, markdown, summary

CHUNK = 10


def measure(runs: int = 500, seed: int = 0, jobs: int = CORES) -> dict[str, Any]:
    """Make as many draws per setting, from this seed on, in that many processes."""
    found: dict[Cell, list[Judged]] = {cell: [] for cell in CELLS}
    seeds = range(seed, seed + runs)
    chunks = [seeds[start : start + CHUNK] for start in range(0, runs, CHUNK)]
    calls = [(cell, partial(judge, cell, chunk)) for chunk in chunks for cell in CELLS]
    for cell, judged in in_processes(calls, jobs):
        found[cell] += judged
    rows = [summary(cell, found[cell]) for cell in CELLS]
    text = f"{runs} draws per setting, seeds from {seed}.\n\n{markdown(rows)}"
    return {"rows": rows, "tables": {"": text}}


if __name__ == "__main__":
    run_program(__doc__, measure, ROOT / "docs" / "data" / "robustness.md")
