"""Whether a run has a launcher that lives, as others see it."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from mrbt_mesh.runtime.launcher import agent_arguments
from mrbt_mesh.runtime.launcher_lock import (
    LauncherWatch,
    is_launched,
    launched_from_here,
    launcher_of,
)
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError, RunInfo

HOLDS = """
import sys
from pathlib import Path
from mrbt_mesh.runtime.launcher_lock import launched_from_here
from mrbt_mesh.runtime.run_dir import RunDir

with launched_from_here(RunDir(Path(sys.argv[1]))):
    print("held", flush=True)
    sys.stdin.read()
"""
# Ends with status 0 by its watch, or never.
WATCHES = """
import sys, threading
from pathlib import Path
from mrbt_mesh.runtime.launcher_lock import LauncherWatch

watch = LauncherWatch(Path(sys.argv[1]), limit_s=0.1)
print("watches", flush=True)
threading.Event().wait()
"""


def run_info() -> RunInfo:
    return RunInfo(
        mission_path="m.yaml",
        mission_name="m",
        options=RobotOptions(team="t", run="r", insecure=True),
        endpoints={"R1": "tcp/127.0.0.1:1"},
        dials={"R1": []},
        started_unix_s=0.0,
        robots=("R1",),
    )


def started(script: str, *arguments: str) -> subprocess.Popen[str]:
    """A process that has said its first word."""
    process = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline()
    return process


def test_only_the_robots_of_a_launched_run_are_told_of_a_launcher(tmp_path: Path) -> None:
    """A detached run never had one; without one, a robot that joins has nobody to go with."""
    run_dir = RunDir(tmp_path)
    command = agent_arguments(run_dir, run_info(), "R1")
    assert "--while-locked" not in command
    with launched_from_here(run_dir):
        told = agent_arguments(run_dir, run_info(), "R1")
    assert told == [*command, "--while-locked", str(tmp_path / "launcher.lock")]
    assert agent_arguments(run_dir, run_info(), "R1") == command


def test_a_run_has_one_launcher_at_a_time(tmp_path: Path) -> None:
    run_dir = RunDir(tmp_path)
    with launched_from_here(run_dir):
        second = launched_from_here(run_dir)
        with pytest.raises(RunDirError, match="another process runs this team"), second:
            pass
        assert is_launched(run_dir)
    with launched_from_here(run_dir):
        assert is_launched(run_dir)
    assert not is_launched(run_dir)


def test_who_looks_for_a_launcher_is_not_taken_for_one(tmp_path: Path) -> None:
    run_dir = RunDir(tmp_path)
    run_dir.launcher_lock_path.touch()
    with run_dir.launcher_lock_path.open() as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        looking = threading.Timer(0.02, fcntl.flock, (file, fcntl.LOCK_UN))
        looking.start()
        with launched_from_here(run_dir):
            found = launcher_of(run_dir)
        looking.join()
    assert found is not None
    assert found.pid == os.getpid()
    assert launcher_of(run_dir) is None


def test_a_run_directory_that_cannot_be_written_is_explained(tmp_path: Path) -> None:
    launched = launched_from_here(RunDir(tmp_path / "none"))
    with pytest.raises(RunDirError, match="cannot write the run directory"), launched:
        pass


def test_a_killed_launcher_is_noticed(tmp_path: Path) -> None:
    """Also told to who asks afterwards."""
    launcher = started(HOLDS, str(tmp_path))
    run_dir = RunDir(tmp_path)
    assert is_launched(run_dir)
    watch = LauncherWatch(run_dir.launcher_lock_path, limit_s=threading.TIMEOUT_MAX)
    told, too_late = threading.Event(), threading.Event()
    watch.call_when_gone(told.set)
    assert not told.is_set()
    launcher.kill()
    assert told.wait(60)
    watch.call_when_gone(too_late.set)
    assert too_late.is_set()
    assert not is_launched(run_dir)
    launcher.communicate()


def test_who_does_not_leave_is_ended(tmp_path: Path) -> None:
    launcher = started(HOLDS, str(tmp_path))
    robot = started(WATCHES, str(RunDir(tmp_path).launcher_lock_path))
    assert robot.poll() is None
    launcher.kill()
    assert robot.wait(60) == 0
    launcher.communicate()
    robot.communicate()
