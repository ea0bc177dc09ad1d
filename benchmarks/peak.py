"""How much memory a solver takes at most: in a process of its own, on top of the problem.

    python -m benchmarks.peak SOLVER INSTANCE.npz LIMIT_S

Prints the MB between what was resident before the solver began and the most there ever was until
it ended. Linux only: it reads and resets the peak in /proc/self.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from benchmarks.instances import Instance
from benchmarks.registry import need
from benchmarks.report import ROOT
from benchmarks.solvers import SOLVERS, TimeLimitError

STATUS = Path("/proc/self/status")
CLEAR = Path("/proc/self/clear_refs")
RESET_PEAK = "5"
PATIENCE_S = 120.0


def save(instance: Instance, file: Path) -> None:
    """Write an instance to a file."""
    np.savez(file, **{each.name: getattr(instance, each.name) for each in fields(instance)})


def read(file: Path) -> Instance:
    """Read what `save` wrote."""
    with np.load(file) as found:
        arrays = {name: found[name] for name in found.files}
    return Instance(int(arrays.pop("robots")), **arrays)


def peak_mb(solver: str, instance: Instance, limit_s: float) -> float | None:
    """The most memory that a solver takes, in a child process; None if that cannot be had."""
    if not CLEAR.exists():
        return None
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        file = Path(folder) / "instance.npz"
        save(instance, file)
        command = [sys.executable, "-m", "benchmarks.peak", solver, str(file), str(limit_s)]
        try:
            done = subprocess.run(
                command,
                cwd=ROOT,
                stdout=subprocess.PIPE,
                timeout=2 * limit_s + PATIENCE_S,
                check=True,
                text=True,
            )
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
            return None
    return float(done.stdout)


def _resident_kb(name: str) -> int:
    for line in STATUS.read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1])
    raise OSError(f"{STATUS} has no {name}")


def main() -> int:
    """Measure one solver."""
    name, file, limit_s = sys.argv[1], Path(sys.argv[2]), float(sys.argv[3])
    solver = SOLVERS[name]
    need(solver.needs)
    problem = solver.prepare(read(file))
    CLEAR.write_text(RESET_PEAK)
    before_kb = _resident_kb("VmRSS")
    try:
        solver.solve(problem, limit_s)
    except TimeLimitError:
        return 1
    sys.stdout.write(f"{(_resident_kb('VmHWM') - before_kb) / 1024:.3f}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
