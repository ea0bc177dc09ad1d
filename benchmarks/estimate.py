"""How many runs of the vehicle repair `mrbt sim estimate` makes in a minute.

    python -m benchmarks.estimate [--runs 200] [--jobs N] [--json FILE]

Six robots, the whole mission in virtual time (24 s), no faults; once in one process, and once in
as many as there are cores. CPU time is of one run in one process, without the start of Python.
"""

from __future__ import annotations

import os
import time
from typing import Any

from benchmarks.report import script_parser, write_json
from benchmarks.run import REPAIR, machine, say
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.estimate import Experiment, outcomes, run_one
from mrbt_mesh.sim.world.setup import NO_FAILURES


def experiment(runs: int) -> Experiment:
    program = load_mission(REPAIR).program
    assert program is not None
    return Experiment(str(REPAIR), program, NO_FAILURES, runs)


def cpu_s(runs: int) -> float:
    """CPU seconds of one run."""
    what = experiment(runs)
    run_one(what, 0)  # what is loaded once
    started_s = time.process_time()
    for number in range(runs):
        run_one(what, number)
    return (time.process_time() - started_s) / runs


def per_minute(runs: int, jobs: int) -> float:
    """Runs in a minute of wall-clock time, the start of the processes included."""
    started_s = time.monotonic()
    found = list(outcomes(experiment(runs), jobs))
    assert all(outcome.result == "success" for outcome in found)
    return 60 * len(found) / (time.monotonic() - started_s)


def main() -> None:
    parser = script_parser(__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    found: dict[str, Any] = {"machine": machine(), "runs": options.runs, "jobs": options.jobs}
    found["cpu_s_per_run"] = round(cpu_s(max(1, options.runs // 10)), 4)
    say(f"one run: {found['cpu_s_per_run'] * 1e3:.0f} ms of CPU")
    found["runs_per_minute"] = round(per_minute(options.runs, options.jobs), 1)
    say(f"{options.jobs} processes: {found['runs_per_minute']:.0f} runs a minute")
    write_json(found, options.json)


if __name__ == "__main__":
    main()
