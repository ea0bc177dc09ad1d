"""Who is thought dead, how soon, and how fast a team agrees, on networks from good to hopeless.

    python -m benchmarks.membership [--full] [--jobs 2] [--json FILE] [--write-docs]

Virtual time; the robots are the real agents with the default knobs. Beside them stands a plain
detector that sees the same beats: dead after the detection time without a beat of the robot
itself. `--full` runs longer and takes hours; `--write-docs` puts the tables into
docs/membership.md.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from benchmarks.membership.jobs import Job, jobs
from benchmarks.membership.networks import Net
from benchmarks.membership.results import markdown, summary
from benchmarks.report import bar_of_jobs, write_docs

DOCS = Path(__file__).resolve().parents[2] / "docs" / "membership.md"


def run_all(todo: list[Job], processes: int) -> dict[tuple[str, int, Net], list[Any]]:
    """All results by kind, size and network."""
    found: dict[tuple[str, int, Net], list[Any]] = {}
    with bar_of_jobs() as progress, ProcessPoolExecutor(processes) as pool:
        bar = progress.add_task("networks", total=len(todo))
        running = {pool.submit(job.run): job for job in todo}
        for future in as_completed(running):
            job = running[future]
            found.setdefault((job.kind, job.robots, job.net), []).append(future.result())
            progress.advance(bar)
    return found


def main() -> None:
    """Run the benchmark."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.membership",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--full", action="store_true", help="more and longer runs: hours")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes (all cores)")
    parser.add_argument("--json", type=Path, help="also write the result here")
    parser.add_argument("--write-docs", action="store_true", help="update docs/membership.md")
    options = parser.parse_args()
    started = time.monotonic()
    todo = list(jobs(options.full))
    tables = summary(run_all(todo, options.jobs))
    text = markdown(tables)
    sys.stdout.write(text + "\n")
    if options.json:
        result = {"seconds": round(time.monotonic() - started), "full": options.full, **tables}
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    if options.write_docs:
        write_docs(DOCS, text)


if __name__ == "__main__":
    main()
