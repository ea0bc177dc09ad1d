"""mrbt up: options that do not go together; what it does is in tests/processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.support.command import EXPLORE, mrbt


def test_without_recordings_there_are_none_of_heartbeats() -> None:
    code, output, problems = mrbt("up", EXPLORE, "--no-record", "--record-beats")
    assert (code, output) == (2, "")
    assert "with --no-record nothing is recorded" in problems


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
