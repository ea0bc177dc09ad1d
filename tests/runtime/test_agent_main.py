"""The arguments of `mrbt agent`: what is wrong is said before anything is opened."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.core.timing import Timing
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.agent_main import (
    AgentInputError,
    claim_run_dir,
    make_driver,
    parser,
    robot_of,
)
from mrbt_mesh.runtime.run_dir import RunDir

EXPLORE = Path(__file__).resolve().parents[2] / "examples" / "explore" / "mission.yaml"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--robot", "Z9"], "has no robot 'Z9' (it has R1, R2); name its --type to add it"),
        (["--robot", "Z9", "--type", "X"], "has no robot type 'X' (explorer)"),
        (["--robot", "a b"], "robot id 'a b': 1 to 32 letters"),
        (["--robot", "R1", "--team", "a/b"], "--team 'a/b': 1 to 32 letters"),
        (["--robot", "R1", "--run", "a:b"], "--run 'a:b': 1 to 32 letters"),
    ],
)
def test_bad_arguments_are_explained(options: list[str], message: str) -> None:
    with pytest.raises(AgentInputError) as error:
        make_driver(parser().parse_args(["--mission", str(EXPLORE), *options]))
    assert message in str(error.value)


def test_a_detection_time_of_less_than_three_beats_is_refused() -> None:
    arguments = ["--mission", str(EXPLORE), "--robot", "R1", "--beat", "0.5"]
    with pytest.raises(ValueError, match="at least 3 beat periods"):
        make_driver(parser().parse_args(arguments))


def test_a_newcomer_of_a_known_type_gets_its_capabilities() -> None:
    mission = load_mission(EXPLORE)
    assert robot_of(mission, "R9", "explorer") == ("explorer", mission.robots["R1"].capabilities)


def test_a_run_directory_has_one_process_per_robot(tmp_path: Path) -> None:
    claim_run_dir(tmp_path, "R1", takeover=False)
    running = RunDir(tmp_path).process("R1")
    assert running is not None
    with pytest.raises(AgentInputError, match=f"already running here .pid {running.pid}"):
        claim_run_dir(tmp_path, "R1", takeover=False)
    claim_run_dir(tmp_path, "R1", takeover=True)


def test_the_knobs_follow_their_formulas() -> None:
    timing = Timing(beat_us=200_000, detection_us=1_000_000)
    assert (timing.limit_us(0), timing.grace_us) == (1_000_000, 300_000)
    assert (timing.fence_us, timing.max_limit_us) == (1_000_000, 3_000_000)
    assert max(timing.repeats_us()) < timing.beat_us
