"""Waits until a detached team has ended, and writes its summary.

    python -m mrbt_mesh.cli.team.summary_writer RUN_DIR

It loads what that takes only then: until then it costs hardly anything.
"""

from __future__ import annotations

import sys
from pathlib import Path

import psutil

from mrbt_mesh.runtime.run_dir import RunDir


def wait_and_write(run_dir: RunDir) -> None:
    """Return once no robot of the run is left, also of those that join later."""
    while running := [p for robot in run_dir.robots() if (p := run_dir.process(robot)) is not None]:
        psutil.wait_procs(running)
    from mrbt_mesh.cli.team.finished import summary_of_finished

    summary_of_finished(run_dir)


if __name__ == "__main__":
    wait_and_write(RunDir(Path(sys.argv[1])))
