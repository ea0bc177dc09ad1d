"""Robots forked from one process: what they run, how they end, and who is not there any more."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from mrbt_mesh import __version__
from mrbt_mesh.runtime.launcher import wait_for_exit
from mrbt_mesh.runtime.robot_forks import CAN_FORK, RobotForks
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError
from tests.support.paths import mission_file

pytestmark = pytest.mark.skipif(not CAN_FORK, reason="robots are forked on Linux")

BLOCKED = """
import os, threading
from mrbt_mesh import RobotProgram
robot = RobotProgram()
with open(os.environ["RUNS"], "w") as told:
    told.write("runs")
threading.Event().wait()
"""


@pytest.fixture
def forks(tmp_path: Path) -> Iterator[Callable[..., RobotForks]]:
    """Makes what forks robots into the test's folder, and ends it."""
    made: list[RobotForks] = []

    def make(arrays: bool = False, **environment: str) -> RobotForks:
        made.append(RobotForks(RunDir(tmp_path), environment, arrays))
        return made[-1]

    yield make
    for one in made:
        one.close()


def test_each_runs_what_it_is_told_and_its_end_is_known(
    forks: Callable[..., RobotForks], tmp_path: Path
) -> None:
    """One ends well, one is refused."""
    found = forks().start({"A1": ["--version"], "A2": ["agent", "--robot", "A2"]})
    for robot in found.values():
        wait_for_exit(robot.pid)
        robot.settle()
    assert {name: robot.returncode for name, robot in found.items()} == {"A1": 0, "A2": 2}
    assert __version__ in RunDir(tmp_path).output_path("A1").read_text()
    assert "--mission" in RunDir(tmp_path).output_path("A2").read_text()


def test_another_thread_may_read_the_answer_that_is_awaited(
    forks: Callable[..., RobotForks], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever asks how robots ended reads what is said to whoever starts some."""
    server, read_before = forks(RUNS=os.devnull), []
    program = tmp_path / "robot.py"
    program.write_text(BLOCKED)
    words = ["agent", "--mission", str(mission_file("explore")), "--robot", "R1", "--insecure"]
    take_news = RobotForks.take_news

    def late(self: RobotForks, timeout_s: float) -> bool:
        if not read_before:
            read_before.append(take_news(self, 60))
        return take_news(self, timeout_s)

    monkeypatch.setattr(RobotForks, "take_news", late)
    (robot,) = server.start({"R1": [*words, "--program", str(program)]}).values()
    assert read_before == [True]
    os.kill(robot.pid, signal.SIGKILL)


def test_a_robot_is_started_again(forks: Callable[..., RobotForks], tmp_path: Path) -> None:
    server = forks()
    pids = []
    for _ in range(2):
        (robot,) = server.start({"A1": ["--version"]}).values()
        wait_for_exit(robot.pid)
        robot.settle()
        assert robot.returncode == 0
        pids.append(robot.pid)
    assert pids[0] != pids[1]
    assert RunDir(tmp_path).output_path("A1").read_text().count(__version__) == 2


def test_a_robot_has_a_session_and_a_name_of_its_own_and_outlives_its_parent(
    forks: Callable[..., RobotForks], tmp_path: Path
) -> None:
    program = tmp_path / "robot.py"
    program.write_text(BLOCKED)
    words = ["agent", "--mission", str(mission_file("explore")), "--robot", "R1", "--insecure"]
    runs = tmp_path / "runs"
    os.mkfifo(runs)
    server = forks(RUNS=str(runs))
    (robot,) = server.start({"R1": [*words, "--program", str(program)]}).values()
    assert runs.read_text() == "runs"
    process = psutil.Process(robot.pid)
    assert os.getsid(robot.pid) == robot.pid
    assert robot.returncode is None
    assert process.name() == "mrbt R1"
    server.close()
    assert process.is_running()
    process.kill()
    wait_for_exit(robot.pid)


def test_solvers_that_were_loaded_before_the_fork_solve_after_it(
    forks: Callable[..., RobotForks], tmp_path: Path
) -> None:
    """Planning tries the named solver out; CP-SAT is loaded in the robot itself."""
    plan = ["plan", str(mission_file("vehicle_repair")), "--json", "--solver"]
    solvers = ("min_cost_flow", "cp_sat")
    found = forks(arrays=True).start({solver: [*plan, solver] for solver in solvers})
    for robot in found.values():
        wait_for_exit(robot.pid)
        robot.settle()
    printed = [RunDir(tmp_path).output_path(solver).read_text() for solver in solvers]
    assert [robot.returncode for robot in found.values()] == [0, 0], printed
    assert printed[0] == printed[1]


def test_a_killed_robot_has_its_signal_as_status(
    forks: Callable[..., RobotForks], tmp_path: Path
) -> None:
    program = tmp_path / "robot.py"
    program.write_text(BLOCKED)
    words = ["agent", "--mission", str(mission_file("explore")), "--robot", "R1", "--insecure"]
    (robot,) = forks(RUNS=os.devnull).start({"R1": [*words, "--program", str(program)]}).values()
    os.kill(robot.pid, signal.SIGKILL)
    wait_for_exit(robot.pid)
    robot.settle()
    assert robot.returncode == -signal.SIGKILL


def test_a_process_that_cannot_fork_is_explained(
    forks: Callable[..., RobotForks], tmp_path: Path
) -> None:
    with pytest.raises(RunDirError, match=r"cannot be started: .*/fork_server\.out"):
        forks(PYTHONHOME=str(tmp_path / "none")).start({"A1": ["--version"]})
    assert RunDir(tmp_path).fork_server_output_path.read_text()
