"""How many runs of the vehicle repair `mrbt sim estimate` makes in a minute.

    python -m benchmarks.estimate [--runs 200] [--jobs N] [--json FILE]

Six robots, the whole mission in virtual time (24 s), no faults; once in one process, and once in
as many as there are cores. CPU time is of one run in one process, without the start of Python.
"""

from __future__ import annotations

import time
from typing import Any

from benchmarks.report import CORES, run_program
from benchmarks.run import REPAIR
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.estimate import Experiment, outcomes, run_one
from mrbt_mesh.sim.world.setup import NO_FAILURES


def measure(runs: int = 200, jobs: int = CORES) -> dict[str, Any]:
    """CPU seconds of one run, and runs in a minute with the start of the processes."""
    program = load_mission(REPAIR).program
    assert program is not None
    experiment = Experiment(str(REPAIR), program, NO_FAILURES, runs)
    few = max(1, runs // 10)
    run_one(experiment, 0)  # what is loaded once
    started_s = time.process_time()
    for number in range(few):
        run_one(experiment, number)
    cpu_s = (time.process_time() - started_s) / few
    started_s = time.monotonic()
    found = list(outcomes(experiment, jobs))
    assert all(outcome.result == "success" for outcome in found)
    per_minute = 60 * len(found) / (time.monotonic() - started_s)
    return {"cpu_s_per_run": round(cpu_s, 4), "runs_per_minute": round(per_minute, 1)}


if __name__ == "__main__":
    run_program(__doc__, measure)
