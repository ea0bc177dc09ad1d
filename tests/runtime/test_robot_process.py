"""One robot's process: what is wrong is said before anything is opened; its run directory."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

import psutil
import pytest

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime import run_dir as run_dir_module
from mrbt_mesh.runtime.process_identity import identity_of
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.robot_process import claim_run_dir, make_driver, robot_of
from mrbt_mesh.runtime.run_dir import RunDir
from tests.support.paths import mission_file

EXPLORE = mission_file("explore")


@pytest.mark.parametrize(
    ("robot", "options", "message"),
    [
        ("Z9", {}, "has no robot 'Z9' (it has R1, R2); name its --type to add it"),
        ("Z9", {"type": "X"}, "has no robot type 'X' (explorer)"),
        ("a b", {}, "robot id 'a b': 1 to 32 letters"),
        ("R1", {"expect": ("R1", "")}, "--expect R1,: '' is not a robot's id"),
        ("R1", {"team": "a/b"}, "--team 'a/b': 1 to 32 letters"),
        ("R1", {"run": "a:b"}, "--run 'a:b': 1 to 32 letters"),
        ("R1", {"beat_s": 0.5}, "at least 3 beat periods"),
    ],
)
def test_a_robot_that_cannot_be_is_explained(
    robot: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as error:
        make_driver(EXPLORE, robot, RobotOptions(**options))
    assert message in str(error.value)


def test_a_newcomer_of_a_known_type_gets_its_capabilities() -> None:
    mission = load_mission(EXPLORE)
    assert robot_of(mission, "R9", "explorer") == ("explorer", mission.robots["R1"].capabilities)


def test_a_robot_without_a_journal_says_that_exclusive_tasks_need_one(tmp_path: Path) -> None:
    def problem(mission: Path, robot: str, run_dir: Path | None) -> str:
        return make_driver(mission, robot, RobotOptions(run_dir=run_dir))._config.journal_problem

    dispense = mission_file("dispense")
    assert problem(dispense, "D1", None).startswith("this robot keeps no journal")
    assert problem(dispense, "D1", tmp_path) == ""
    assert problem(EXPLORE, "R1", None) == ""


def fill_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(run_dir_module, "write_atomically", full)


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    fill_disk(monkeypatch)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_does_not_keep_a_robot_with_a_directory_of_its_own(tmp_path: Path) -> None:
    assert claim_run_dir(tmp_path, "R1", takeover=False) == "No space left on device"


@pytest.mark.usefixtures("full_disk")
def test_a_robot_that_no_command_would_find_does_not_start(tmp_path: Path) -> None:
    (tmp_path / "run.json").touch()
    with pytest.raises(InputError, match=r"R1 does not start.*No space left on device; make room"):
        claim_run_dir(tmp_path, "R1", takeover=False)


@pytest.mark.usefixtures("full_disk")
@pytest.mark.parametrize("before", [{"pid": 1}, {"pid": 1, "started": "x" * 200}])
def test_on_a_full_disk_the_file_of_an_earlier_life_has_room(
    tmp_path: Path, before: object
) -> None:
    (tmp_path / "run.json").touch()
    (tmp_path / "R1.process").write_text(json.dumps(before))
    assert claim_run_dir(tmp_path, "R1", takeover=False) == ""
    running = RunDir(tmp_path).process("R1")
    assert running is not None
    assert running.pid == os.getpid()


def test_the_file_of_the_process_is_written_once_there_is_room(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        fill_disk(patch)
        claim_run_dir(tmp_path, "R1", takeover=False)
        RunDir(tmp_path).mark_alive("R1")
    assert RunDir(tmp_path).process("R1") is None
    RunDir(tmp_path).mark_alive("R1")
    assert RunDir(tmp_path).process("R1") is not None


def test_a_run_directory_has_one_process_per_robot(tmp_path: Path) -> None:
    parent = psutil.Process(os.getppid())
    (tmp_path / "R1.process").write_text(identity_of(parent.pid))
    with pytest.raises(InputError, match=f"already running here .pid {parent.pid}"):
        claim_run_dir(tmp_path, "R1", takeover=False)
    claim_run_dir(tmp_path, "R1", takeover=True)
    running = RunDir(tmp_path).process("R1")
    assert running is not None
    assert running.pid == os.getpid()


def test_a_run_directory_that_a_robot_makes_is_its_users_alone(tmp_path: Path) -> None:
    claim_run_dir(tmp_path / "run", "R1", takeover=False)
    modes = [path.stat().st_mode & 0o077 for path in (tmp_path / "run", *tmp_path.glob("run/*"))]
    assert modes == [0, 0]


def test_the_same_pid_in_a_container_that_was_started_again_is_nobody_else(tmp_path: Path) -> None:
    claim_run_dir(tmp_path, "R1", takeover=False)
    claim_run_dir(tmp_path, "R1", takeover=False)


def test_a_sign_of_life_is_the_time_of_the_process_file(tmp_path: Path) -> None:
    claim_run_dir(tmp_path, "R1", takeover=False)
    os.utime(tmp_path / "R1.process", (0, 0))
    RunDir(tmp_path).mark_alive("R1")
    assert (tmp_path / "R1.process").stat().st_mtime > 0
    RunDir(tmp_path / "gone").mark_alive("R1")  # the robot goes on
    assert not (tmp_path / "gone").exists()


def test_the_knobs_follow_their_formulas() -> None:
    timing = Timing(heartbeat_us=200_000, detection_us=1_000_000)
    assert (timing.silence_limit_us(0), timing.grace_us) == (1_000_000, 300_000)
    assert (timing.fence_us, timing.max_silence_us) == (1_000_000, 3_000_000)
    assert max(timing.repeat_offsets_us()) < timing.heartbeat_us
