"""`mrbt sim --chaos`: what it prints, writes and returns, also for what fails."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from mrbt_mesh.cli.sim import sim
from tests.support.mutations import MUTATIONS
from tests.support.runs import EXAMPLES

EXPLORE = str(EXAMPLES / "explore" / "mission.yaml")


def mrbt_sim(*arguments: str) -> Result:
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command("sim")(sim)
    return CliRunner().invoke(app, list(arguments))


def test_a_campaign_that_breaks_nothing(tmp_path: Path) -> None:
    keep = tmp_path / "kept"
    result = mrbt_sim(EXPLORE, "--chaos", "--seeds", "0:5", "--keep", str(keep))
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "no invariant broken" in text
    assert "5 seeds in" in text
    assert "I3 nothing done is undone" in text
    assert not keep.exists()


def test_the_same_in_two_processes_as_json(tmp_path: Path) -> None:
    arguments = ("--generated", "--chaos", "--seeds", "0:6", "--json", "--keep", str(tmp_path))
    one, two = mrbt_sim(*arguments), mrbt_sim(*arguments, "--jobs", "2")
    assert (one.exit_code, two.exit_code) == (0, 0), one.output + two.output
    first, second = json.loads(one.stdout), json.loads(two.stdout)
    assert first["seeds"] == 6
    assert first["failures"] == []
    for key in ("results", "checks", "seeds_checked", "done_twice", "exclusive_done_twice"):
        assert first[key] == second[key]


def test_a_failure_is_cut_down_written_and_replayed(tmp_path: Path) -> None:
    with MUTATIONS["outcomes_dropped_at_restart"]():
        arguments = ("--chaos", "--generated", "--seeds", "4", "--keep", str(tmp_path))
        result = mrbt_sim(*arguments, "--minimise", "20")
        assert result.exit_code == 1
        text = " ".join(result.stdout.split())
        assert "seed 4 I9 at" in text
        assert "are enough" in text
        assert "mrbt sim --chaos --generated --seeds 4" in text
        minimised = tmp_path / "seed-4-minimised.json"
        assert f"mrbt sim --schedule {minimised}" in text
        scenario = json.loads(minimised.read_text())
        kinds = {fault["fault"] for _, fault in scenario["steps"]}
        assert kinds == {"Restart", "Heal"} or kinds == {"Kill", "Heal"}, kinds
        assert {path.name for path in tmp_path.iterdir()} == {
            "random_robot.py",
            "seed-4.json",
            "seed-4-minimised.json",
            "seed-4.yaml",
        }
        for path in (minimised, tmp_path / "seed-4.json"):
            replayed = mrbt_sim("--schedule", str(path), "--json")
            assert replayed.exit_code == 1
            assert json.loads(replayed.stdout)["violations"][0].startswith("I9")
    # Without the bug, nothing is wrong with it.
    assert mrbt_sim("--schedule", str(minimised)).exit_code != 1


def test_a_generated_mission_without_chaos() -> None:
    result = mrbt_sim("--generated", "--seed", "0", "--timeout", "60", "--json")
    assert result.exit_code in (0, 1, 3), result.output
    assert json.loads(result.stdout)["violations"] == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--chaos"], "give a MISSION, or --generated"),
        ([EXPLORE, "--generated"], "give a MISSION or --generated, not both"),
        ([EXPLORE, "--chaos", "--seeds", "x"], "--seeds x: expected FIRST:END, e.g. 0:1000"),
        ([EXPLORE, "--chaos", "--seeds", "5:5"], "--seeds 5:5: expected FIRST:END"),
        ([EXPLORE, "--chaos", "--schedule", "x.json"], "give one of them"),
        (["--schedule", "/nonexistent.json"], "cannot be read: No such file"),
    ],
)
def test_bad_input_exits_2_and_says_what_would_be_right(arguments: list[str], message: str) -> None:
    result = mrbt_sim(*arguments)
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[", "Expecting value"),
        ("[]", "an object with mission, seed, robots, steps is expected"),
        ('{"seed": 1, "robots": ["R1"], "steps": [], "heal_us": 1}', "Scenario needs 'timeout_us'"),
        (
            '{"seed": 1, "robots": ["R1"], "steps": [], "heal_us": 1, "timeout_us": 2}',
            "names no mission; give one",
        ),
    ],
)
def test_a_bad_schedule_file_exits_2(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "schedule.json"
    path.write_text(text)
    result = mrbt_sim("--schedule", str(path))
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.stderr.split())


def test_a_schedule_of_robots_that_the_mission_lacks_exits_2(tmp_path: Path) -> None:
    path = tmp_path / "schedule.json"
    path.write_text('{"seed": 1, "robots": ["Z"], "steps": [], "heal_us": 1, "timeout_us": 2}')
    result = mrbt_sim(EXPLORE, "--schedule", str(path))
    assert result.exit_code == 2, result.output
    assert "mission explore has no robot Z" in " ".join(result.stderr.split())
