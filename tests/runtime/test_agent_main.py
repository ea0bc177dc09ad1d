"""The arguments of `mrbt agent`: what is wrong is said before anything is opened."""

from __future__ import annotations

import json
import os
from pathlib import Path

import psutil
import pytest

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.agent_main import (
    InputError,
    claim_run_dir,
    make_driver,
    parser,
    robot_of,
)
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team_address import AddressError
from tests.support.paths import mission_file

EXPLORE = mission_file("explore")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--robot", "Z9"], "has no robot 'Z9' (it has R1, R2); name its --type to add it"),
        (["--robot", "Z9", "--type", "X"], "has no robot type 'X' (explorer)"),
        (["--robot", "a b"], "robot id 'a b': 1 to 32 letters"),
    ],
)
def test_bad_arguments_are_explained(options: list[str], message: str) -> None:
    with pytest.raises(InputError) as error:
        make_driver(parser().parse_args(["--mission", str(EXPLORE), *options]))
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--team", "a/b"], "--team 'a/b': 1 to 32 letters"),
        (["--run", "a:b"], "--run 'a:b': 1 to 32 letters"),
        (["--beat", "0.5"], "at least 3 beat periods"),
    ],
)
def test_an_address_that_cannot_be_is_explained(options: list[str], message: str) -> None:
    with pytest.raises(AddressError) as error:
        make_driver(parser().parse_args(["--mission", str(EXPLORE), "--robot", "R1", *options]))
    assert message in str(error.value)


def test_variables_stand_for_options_and_options_win(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("MISSION", "m.yaml"), ("TEAM", "t"), ("RUN", "r")):
        monkeypatch.setenv(f"MRBT_{name}", value)
    options = parser().parse_args(["--robot", "R1", "--team", "other"])
    assert (options.mission, options.team, options.run) == (Path("m.yaml"), "other", "r")


def test_a_newcomer_of_a_known_type_gets_its_capabilities() -> None:
    mission = load_mission(EXPLORE)
    assert robot_of(mission, "R9", "explorer") == ("explorer", mission.robots["R1"].capabilities)


def test_a_run_directory_has_one_process_per_robot(tmp_path: Path) -> None:
    parent = psutil.Process(os.getppid())
    record = {"pid": parent.pid, "started_unix_s": parent.create_time()}
    (tmp_path / "R1.process").write_text(json.dumps(record))
    with pytest.raises(InputError, match=f"already running here .pid {parent.pid}"):
        claim_run_dir(tmp_path, "R1", takeover=False)
    claim_run_dir(tmp_path, "R1", takeover=True)
    running = RunDir(tmp_path).process("R1")
    assert running is not None
    assert running.pid == os.getpid()


def test_the_same_pid_in_a_container_that_was_started_again_is_nobody_else(tmp_path: Path) -> None:
    claim_run_dir(tmp_path, "R1", takeover=False)
    claim_run_dir(tmp_path, "R1", takeover=False)


def test_a_sign_of_life_is_the_time_of_the_process_file(tmp_path: Path) -> None:
    claim_run_dir(tmp_path, "R1", takeover=False)
    os.utime(tmp_path / "R1.process", (0, 0))
    RunDir(tmp_path).mark_alive("R1")
    assert (tmp_path / "R1.process").stat().st_mtime > 0
    RunDir(tmp_path).mark_alive("R2")  # the folder was emptied: the robot goes on
    assert not (tmp_path / "R2.process").exists()


def test_the_knobs_follow_their_formulas() -> None:
    timing = Timing(heartbeat_us=200_000, detection_us=1_000_000)
    assert (timing.silence_limit_us(0), timing.grace_us) == (1_000_000, 300_000)
    assert (timing.fence_us, timing.max_silence_us) == (1_000_000, 3_000_000)
    assert max(timing.repeat_offsets_us()) < timing.heartbeat_us
