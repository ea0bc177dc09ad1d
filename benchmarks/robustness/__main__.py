"""How often a team reaches its goal although robots die of their work, against MRBTP.

    python -m benchmarks.robustness [--runs 500] [--jobs 2] [--json FILE] [--write-docs]

Robots open four rooms and move four packages; each of them dies with some probability whenever it
completes an action. docs/explanation/robustness.md describes the experiment and the columns.
"""

from __future__ import annotations

import os
import time
from functools import partial

from benchmarks.report import finish, in_processes, page_parser, positive
from benchmarks.robustness.draws import CELLS, Cell
from benchmarks.robustness.results import Judged, judge, markdown, summary
from benchmarks.run import ROOT

DOCS = ROOT / "docs" / "data" / "robustness.md"
CHUNK = 10


def main() -> None:
    """Run the benchmark."""
    parser = page_parser(__doc__, DOCS)
    parser.add_argument("--jobs", type=positive, default=os.cpu_count(), help="processes")
    parser.add_argument("--runs", type=positive, default=500, help="draws per setting (500)")
    parser.add_argument("--seed", type=int, default=0, help="the first draw's seed (0)")
    options = parser.parse_args()
    started_s = time.monotonic()
    found: dict[Cell, list[Judged]] = {cell: [] for cell in CELLS}
    seeds = range(options.seed, options.seed + options.runs)
    chunks = [seeds[start : start + CHUNK] for start in range(0, len(seeds), CHUNK)]
    calls = [(cell, partial(judge, cell, chunk)) for chunk in chunks for cell in CELLS]
    for cell, judged in in_processes(calls, options.jobs):
        found[cell] += judged
    rows = [summary(cell, found[cell]) for cell in CELLS]
    text = f"{options.runs} draws per setting, seeds from {options.seed}.\n\n{markdown(rows)}"
    seconds = round(time.monotonic() - started_s)
    result = {"runs": options.runs, "seed": options.seed, "seconds": seconds, "rows": rows}
    finish(text, result, DOCS, options)


if __name__ == "__main__":
    main()
