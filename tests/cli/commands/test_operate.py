"""Commands that act on a running team: what they refuse."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import psutil

from tests.support.command import done, mrbt, refused
from tests.support.run_dirs import a_run


def test_a_robot_that_runs_is_not_joined_and_a_frozen_one_is_to_be_thawed(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        run_dir = a_run(tmp_path / "run", {"R1": process.pid}).path
        join = ("join", "R1", "--run-dir", str(run_dir))
        said = refused(mrbt(*join))
        assert f"R1 is already running (pid {process.pid}): stop it first" in said
        done(mrbt("freeze", "R1", "--run-dir", str(run_dir)))
        while psutil.Process(process.pid).status() != psutil.STATUS_STOPPED:
            time.sleep(0)
        said = refused(mrbt(*join))
        assert f"(pid {process.pid}) and frozen: `mrbt thaw R1` lets it go on" in said
        process.kill()
