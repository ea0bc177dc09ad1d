"""How often a team reaches its goal although robots die of their work, against MRBTP.

    python -m benchmarks.robustness [--runs 500] [--jobs 2] [--json FILE] [--write-docs]

Four rooms are opened and four packages moved by robots of which each dies with some probability
whenever it completes an action. docs/robustness.md describes the experiment and the columns.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path

from benchmarks.report import bar_of_jobs, write_docs
from benchmarks.robustness.draws import CELLS, Cell
from benchmarks.robustness.results import Judged, judge, markdown, summary

DOCS = Path(__file__).resolve().parents[2] / "docs" / "robustness.md"
CHUNK = 10


def run_all(runs: int, seed: int, jobs: int) -> dict[Cell, list[Judged]]:
    """Judge `runs` draws per cell, in `jobs` processes, with progress on standard error."""
    found: dict[Cell, list[Judged]] = {cell: [] for cell in CELLS}
    context = multiprocessing.get_context("spawn")
    with bar_of_jobs() as progress, ProcessPoolExecutor(jobs, mp_context=context) as pool:
        bar = progress.add_task("draws", total=runs * len(CELLS))
        running: dict[Future[list[Judged]], Cell] = {}
        for start in range(seed, seed + runs, CHUNK):
            seeds = range(start, min(start + CHUNK, seed + runs))
            for cell in CELLS:
                running[pool.submit(judge, cell, seeds)] = cell
        for future in as_completed(running):
            judged = future.result()
            found[running[future]] += judged
            progress.advance(bar, len(judged))
    return found


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"a number from 1 is expected, found {text}")
    return number


def main() -> None:
    """Run the benchmark."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.robustness",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--runs", type=_count, default=500, help="draws per setting (500)")
    parser.add_argument("--seed", type=int, default=0, help="the first draw's seed (0)")
    parser.add_argument("--jobs", type=_count, default=os.cpu_count(), help="processes (all cores)")
    parser.add_argument("--json", type=Path, help="also write the result here")
    parser.add_argument("--write-docs", action="store_true", help="update docs/robustness.md")
    options = parser.parse_args()
    started = time.monotonic()
    found = run_all(options.runs, options.seed, options.jobs)
    rows = [summary(cell, found[cell]) for cell in CELLS]
    text = f"{options.runs} draws per setting, seeds from {options.seed}.\n\n{markdown(rows)}"
    sys.stdout.write(text + "\n")
    if options.json:
        seconds = round(time.monotonic() - started)
        result = {"runs": options.runs, "seed": options.seed, "seconds": seconds, "rows": rows}
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    if options.write_docs:
        write_docs(DOCS, text)


if __name__ == "__main__":
    main()
