"""`mrbt sim chaos`: what it prints, writes and returns, also for what fails."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrbt_mesh.cli.commands.chaos import parse_seeds
from mrbt_mesh.errors import InputError
from tests.support.command import EXPLORE, done, mrbt, refused
from tests.support.mutations import MUTATIONS

# In this process: other ones would not know of mutations, and take a second to start.
ONE = ("--jobs", "1")


def chaos(*arguments: str) -> tuple[int, str, str]:
    return mrbt("sim", "chaos", *arguments)


def test_a_campaign_that_breaks_nothing(tmp_path: Path) -> None:
    keep = tmp_path / "kept"
    text = " ".join(done(chaos(EXPLORE, "--seeds", "0:5", "--keep", str(keep), *ONE)).split())
    assert "no invariant broken" in text
    assert "5 seeds in" in text
    assert "I3 nothing done is undone" in text
    assert not keep.exists()


@pytest.mark.slow
def test_the_same_in_two_processes_as_json(tmp_path: Path) -> None:
    arguments = ("--generated", "--seeds", "6,9,11", "--json", "--keep", str(tmp_path))
    found = []
    for jobs in ("1", "2"):
        output = done(chaos(*arguments, "--jobs", jobs))
        found.append(json.loads(output))
    first, second = found
    assert first["seeds"] == 3
    assert first["failures"] == []
    for key in ("results", "checks", "seeds_checked", "done_twice", "exclusive_done_twice"):
        assert first[key] == second[key]


@pytest.mark.slow
def test_a_failure_is_cut_down_written_and_replayed(tmp_path: Path) -> None:
    with MUTATIONS["outcomes_dropped_at_restart"]():
        arguments = ("--generated", "--seeds", "4", "--keep", str(tmp_path), *ONE)
        code, output, _ = chaos(*arguments, "--minimise", "90")
        assert code == 1
        text = " ".join(output.split())
        assert "seed 4 I9 at" in text
        assert "are enough" in text
        assert "mrbt sim chaos --generated --seeds 4" in text
        minimised = tmp_path / "seed-4-minimised.json"
        assert f"mrbt sim run --schedule {minimised}" in text
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
            code, output, _ = mrbt("sim", "run", "--schedule", str(path), "--json")
            assert code == 1
            assert json.loads(output)["violations"][0].startswith("I9")
    # Without the bug, nothing is wrong with it.
    assert mrbt("sim", "run", "--schedule", str(minimised))[0] != 1


def test_for_some_time_from_a_seed_on(tmp_path: Path) -> None:
    arguments = ("--seeds", "7", "--minutes", "0.01", "--keep", str(tmp_path), *ONE, "--json")
    assert json.loads(done(chaos(EXPLORE, *arguments)))["seeds"] >= 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give a MISSION, or --generated"),
        ([EXPLORE, "--generated"], "give a MISSION, or --generated"),
        (["--generated", "--program", "robot.py"], "--program: a generated mission has a program"),
        ([EXPLORE, "--seeds", "x"], "--seeds x: expected FIRST:END, e.g. 0:1000"),
        ([EXPLORE, "--seeds", "5:5"], "--seeds 5:5: expected FIRST:END"),
        ([EXPLORE, "--seeds", "3,-9"], "--seeds 3,-9: expected FIRST:END"),
        ([EXPLORE, "--seeds", "0:9", "--minutes", "1"], "with --minutes only the first seed"),
        ([EXPLORE, "--seeds", "3,9", "--minutes", "1"], "with --minutes only the first seed"),
        ([EXPLORE, "--minutes", "0"], "is not in the range x>0"),
        ([EXPLORE, "--minutes", "nan"], "a number of at most"),
        ([EXPLORE, "--minimise", "-1"], "is not in the range x>=0"),
        ([EXPLORE, "--speed", "0"], "0.01<=x<=1000"),
        ([EXPLORE, "--jobs", "0"], "1<=x<=1024"),
        ([EXPLORE, "--keep", EXPLORE], "is a file; name a folder"),
        ([EXPLORE, "--kill", "NOBODY@1"], "No such option '--kill'"),
        ([EXPLORE, "--loss", "7"], "No such option '--loss'"),
        ([EXPLORE, "--seed", "3"], "No such option '--seed'"),
        (["nowhere.yaml"], "nowhere.yaml: there is no such file"),
    ],
)
def test_bad_input_exits_2_and_says_what_would_be_right(arguments: list[str], message: str) -> None:
    assert message in refused(chaos(*arguments))


def test_seeds_are_a_range_or_a_list() -> None:
    assert parse_seeds("3:6", is_endless=False) == range(3, 6)
    assert parse_seeds("7", is_endless=True) == [7]
    assert parse_seeds("9,3", is_endless=False) == [9, 3]
    assert parse_seeds(None, is_endless=True)[0] == 0
    assert len(parse_seeds("0:1000000000000", is_endless=False)) == 10**12, "not written out"
    with pytest.raises(InputError, match="a seed is named twice"):
        parse_seeds("3,3", is_endless=False)
