"""False deaths, detection times and agreement on networks from good to hopeless.

    python -m benchmarks.membership [--full] [--jobs 2] [--json FILE] [--write-docs]

Virtual time; the robots are the real agents with the default timing. A plain detector sees the
same heartbeats for comparison: it declares a robot dead after the detection time without one.
`--full` takes hours; `--write-docs` puts the tables into docs/explanation/membership.md.
"""

from __future__ import annotations

import os
import time
from typing import Any

from benchmarks.membership.jobs import jobs
from benchmarks.membership.networks import Net
from benchmarks.membership.results import markdown, summary
from benchmarks.report import finish, in_processes, page_parser, positive
from benchmarks.run import ROOT

DOCS = ROOT / "docs" / "data" / "membership.md"


def main() -> None:
    """Run the benchmark."""
    parser = page_parser(__doc__, DOCS)
    parser.add_argument("--jobs", type=positive, default=os.cpu_count(), help="processes")
    parser.add_argument("--full", action="store_true", help="more and longer runs: hours")
    options = parser.parse_args()
    started_s = time.monotonic()
    found: dict[tuple[str, int, Net], list[Any]] = {}
    calls = [((job.kind, job.robots, job.net), job.run) for job in jobs(options.full)]
    for key, result in in_processes(calls, options.jobs):
        found.setdefault(key, []).append(result)
    tables = summary(found)
    seconds = round(time.monotonic() - started_s)
    result = {"seconds": seconds, "full": options.full, **tables}
    finish(markdown(tables), result, DOCS, options)


if __name__ == "__main__":
    main()
