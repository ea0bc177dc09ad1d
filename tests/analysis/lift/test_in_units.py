"""A tree lifted in units does what the single robot's tree does, also where robots die."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from mrbt_mesh.analysis.lift import units as units_module
from mrbt_mesh.sim import Kill, Schedule, simulate
from tests.support.unit_trees import Story, UnitGrower, alone, in_units, program

S = 1_000_000
CASES = int(os.environ.get("MRBT_EXAMPLES", "25"))
RESULTS = {"SUCCESS": "success", "FAILURE": "failure", "SKIPPED": "success"}


def grown(seed: int, with_parallel: bool = False) -> str:
    return UnitGrower(random.Random(f"units/{seed}"), with_parallel).document()


def check(seed: int, folder: Path) -> int:
    """One robot does the same in the same order; how many units there were."""
    text = grown(seed)
    single, team = Story(seed), Story(seed)
    result = alone(text, single)
    found, mission = in_units(text, folder, 1)
    run = simulate(mission, program(team), seed=seed, timeout_us=60 * S)
    assert (run.result, team.log) == (RESULTS[result], single.log), f"seed {seed}: {text}"
    return len(found.tasks.uses)


@settings(max_examples=CASES, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 10_000_000))
@example(101042)  # skipped as a whole
@example(577)  # ends with an error
def test_one_robot_does_the_same_leaves_in_the_same_order(tmp_path: Path, seed: int) -> None:
    check(seed, tmp_path)


def test_of_many_trees_some_are_split(tmp_path: Path) -> None:
    counts = [check(seed, tmp_path) for seed in range(CASES)]
    assert sum(count > 1 for count in counts) > CASES // 10


@pytest.mark.parametrize("rule", [pytest.param("carried", marks=pytest.mark.slow), "shared"])
def test_without_one_of_its_rules_a_split_goes_wrong(
    rule: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So the tests above would notice."""
    if rule == "carried":
        monkeypatch.setattr(units_module, "carried", lambda *_: "")
    else:
        monkeypatch.setattr(units_module.Splitter, rule, lambda *_: ())

    def check_all() -> None:
        for seed in range(400):
            check(seed, tmp_path)

    with pytest.raises(AssertionError, match="seed"):
        check_all()


def check_with_deaths(seed: int, folder: Path) -> str:
    """Three robots, of which one or two die, do no worse than one that lives."""
    text = grown(seed, with_parallel=True)
    single = Story(seed, by_turn=False)
    result = alone(text, single)
    found, mission = in_units(text, folder, 3)
    source = random.Random(f"deaths/{seed}")
    dead = source.sample(["R1", "R2", "R3"], source.randint(1, 2))
    kills: Schedule = [(source.randint(0, 6 * S), Kill(robot)) for robot in dead]
    team = Story(seed, by_turn=False)
    run = simulate(mission, program(team), seed=seed, schedule=kills, timeout_us=120 * S)
    assert run.violations == []
    assert run.result == RESULTS[result], f"seed {seed}, {kills}: {text}"
    return "split" if len(found.tasks.uses) > 1 and single.log else "whole"


@pytest.mark.slow
def test_a_team_ends_as_one_robot_does_also_where_robots_die(tmp_path: Path) -> None:
    found = [check_with_deaths(seed, tmp_path) for seed in range(CASES)]
    assert found.count("split") > CASES // 10
