"""mrbt up: too few open files. Teams that it starts are in tests/processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.support.command import EXPLORE


def test_too_few_open_files_are_said_in_one_line_before_robots_start(tmp_path: Path) -> None:
    command = (
        f"ulimit -n 30; exec {sys.executable} -m mrbt_mesh up {EXPLORE} --run-dir {tmp_path}/r"
    )
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: a process may open 30 files here (ulimit -n), and each ")
    assert "2 robots needs 40" in done.stderr
    assert done.stderr.count("\n") == 1
    assert list((tmp_path / "r").glob("*.process")) == []
