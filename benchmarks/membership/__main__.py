"""False deaths, detection times and agreement on networks from good to hopeless.

    python -m benchmarks.membership [--full] [--jobs 2] [--json FILE] [--write-docs]

Virtual time; the robots are the real agents with the default timing. A plain detector sees the
same heartbeats for comparison: it declares a robot dead after the detection time without one.
`--full` takes hours; `--write-docs` puts the tables into docs/data/membership.md.
"""

from __future__ import annotations

from typing import Any

from benchmarks.membership.jobs import Key, calls
from benchmarks.membership.results import markdown, summary
from benchmarks.report import CORES, ROOT, in_processes, run_program


def measure(full: bool = False, jobs: int = CORES) -> dict[str, Any]:
    """Make all runs, in that many processes."""
    found: dict[Key, list[Any]] = {}
    for key, result in in_processes(list(calls(full)), jobs):
        found.setdefault(key, []).append(result)
    tables = summary(found)
    return {**tables, "tables": {"": markdown(tables)}}


if __name__ == "__main__":
    run_program(__doc__, measure, ROOT / "docs" / "data" / "membership.md")
