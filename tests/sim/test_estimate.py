"""Experiments: the same figures whatever the number of processes, and what they say."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim import simulate
from mrbt_mesh.sim.estimate import (
    NETWORK,
    Experiment,
    outcomes,
    run_one,
    summarise,
    wilson,
)
from mrbt_mesh.sim.parallel import spread
from mrbt_mesh.sim.world.setup import EVERYBODY, NO_FAILURES, FailureModel, Rate
from tests.support.effort import at_size
from tests.support.paths import EXAMPLES

REPAIR = str(EXAMPLES / "vehicle_repair" / "mission.yaml")
EXPLORE = str(EXAMPLES / "explore" / "mission.yaml")


def experiment(mission: str, runs: int, failures: FailureModel = NO_FAILURES) -> Experiment:
    program = load_mission(mission).program
    assert program is not None
    return Experiment(mission, program, failures, runs)


# -- reproducible -----------------------------------------------------------------------------


@pytest.mark.slow
def test_the_same_figures_whatever_the_number_of_processes() -> None:
    shaky = FailureModel(major={EVERYBODY: Rate(per_action=0.2)}, minor={"A": Rate(per_action=0.1)})
    what = experiment(EXPLORE, 9, shaky)
    alone = list(outcomes(what, 1))
    together = list(outcomes(what, 2))
    assert sorted(alone, key=repr) == sorted(together, key=repr)
    texts = [json.dumps(summarise(found)) for found in (alone, together)]
    assert texts[0] == texts[1]


def test_a_run_can_be_looked_at_with_its_seed_alone() -> None:
    what = experiment(REPAIR, 1)
    mission = load_mission(REPAIR)
    from mrbt_mesh.runtime.program_loader import load_program

    single = simulate(mission, load_program(what.program), seed=what.seed_of(7), network=NETWORK)
    assert run_one(what, 7).summary == single.summary
    assert single.violations == []


def test_work_is_spread_in_any_order_and_all_of_it_done() -> None:
    assert sorted(spread(abs, range(-20, 3), 2)) == sorted(map(abs, range(-20, 3)))


def test_closing_early_leaves_the_rest_undone() -> None:
    asked: list[int] = []

    def items() -> Iterator[int]:
        for number in range(1_000):
            asked.append(number)
            yield number

    answers = spread(abs, items(), 2)
    next(answers)
    answers.close()  # type: ignore[attr-defined]
    assert len(asked) < 100


# -- what the outcomes say --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [  # by hand from the formula of 1927, z = 1.959964
        (0, 10, 0.0, 0.277533),
        (10, 10, 0.722467, 1.0),
        (5, 10, 0.236593, 0.763407),
        (81, 263, 0.255289, 0.366162),  # Newcombe 1998, table I
        (15, 148, 0.062386, 0.160519),
    ],
)
def test_wilson_interval(successes: int, runs: int, low: float, high: float) -> None:
    found = wilson(successes, runs)
    assert math.isclose(found[0], low, abs_tol=6e-4)
    assert math.isclose(found[1], high, abs_tol=6e-4)


def test_percentiles_are_linear_between_values() -> None:
    def percentiles(*durations_s: float) -> list[float]:
        found = summarise(("success", each) for each in durations_s)["duration_s"]
        return [found[name] for name in ("p5", "p50", "p95")]

    assert percentiles(*range(21)) == [1, 10, 19]
    assert percentiles(7.0) == [7.0] * 3


def test_a_summary_counts_what_came_out() -> None:
    found = [
        ("blocked", 60.0),
        ("success", 10.0),
        ("success", 20.0),
        ("success", 12.0),
    ]
    summary = summarise(found)
    assert summary == summarise(reversed(found))
    assert summary["runs"] == 4
    assert summary["success"]["probability"] == 0.75
    assert summary["success"]["low"] < 0.75 < summary["success"]["high"]
    assert summary["results"] == {"blocked": 1, "success": 3}
    assert summary["duration_s"]["p50"] == 12.0
    assert list(summary["duration_s"].values()) == sorted(summary["duration_s"].values())
    nothing = summarise(found[:1])
    assert nothing["duration_s"] is None
    assert nothing["success"]["probability"] == 0


@pytest.mark.slow
def test_higher_rates_never_make_the_repair_more_likely() -> None:
    """Common seeds, and each time the same draws: whoever dies at a rate dies at a higher one."""
    runs = at_size(quick=2, gate=5)
    rates = [FailureModel(major={"C": Rate(per_action=p)}) for p in (0.0, 0.3, 1.0)]
    found = [summarise(outcomes(experiment(REPAIR, runs, each), 1)) for each in rates]
    chances = [each["success"]["probability"] for each in found]
    assert (chances[0], chances[-1]) == (1.0, 0.0)
    assert chances == sorted(chances, reverse=True)
