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
    RunOutcome,
    outcomes,
    percentile,
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
    shaky = FailureModel(major={EVERYBODY: Rate(per_action=0.2)}, minor_faults=1)
    what = experiment(EXPLORE, 9, shaky)
    alone = list(outcomes(what, 1))
    together = list(outcomes(what, 2))
    assert sorted(alone, key=repr) == sorted(together, key=repr)
    texts = [json.dumps(summarise(found).to_json()) for found in (alone, together)]
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
    assert percentile([1.0, 2.0, 4.0], 50) == 2.0
    assert percentile([1.0, 2.0, 4.0], 75) == 3.0
    assert percentile([7.0], 95) == 7.0


def test_a_summary_counts_what_came_out() -> None:
    found = [
        RunOutcome(3, "blocked", 60_000_000, 2, 0),
        RunOutcome(0, "success", 10_000_000, 0, 0),
        RunOutcome(1, "success", 20_000_000, 1, 0),
        RunOutcome(2, "success", 12_000_000, 0, 0),
    ]
    summary = summarise(found)
    assert summary.probability == 0.75
    assert summary.durations_s == (10.0, 12.0, 20.0)
    assert summary.mean_s == 14.0
    assert dict(summary.results) == {"blocked": 1, "success": 3}
    assert summary.by_faults == {(0, 0): (2, 2, 11.0), (1, 0): (1, 1, 20.0), (2, 0): (1, 0, 0.0)}
    edges, counts = summary.histogram(5)
    assert counts == [1, 1, 0, 0, 1]
    assert edges[0] == 10.0
    assert edges[-1] == 20.0
    data = summary.to_json()
    assert data["duration_s"]["p50"] == 12.0
    assert data["by_faults"][2]["mean_duration_s"] is None
    nothing = summarise(found[:1]).to_json()
    assert nothing["duration_s"] is None
    assert nothing["success"]["probability"] == 0


@pytest.mark.slow
def test_more_faults_never_make_the_repair_more_likely() -> None:
    """Common seeds: the first k faults of a run are the same, so success can only be lost."""
    runs = at_size(quick=2, gate=5)
    summaries = [
        summarise(outcomes(experiment(REPAIR, runs, FailureModel(major_faults=number)), 1))
        for number in range(4)
    ]
    chances = [summary.probability for summary in summaries]
    assert chances[0] == 1.0
    assert chances == sorted(chances, reverse=True)
    assert [summary.major_faults for summary in summaries][:2] == [0.0, 1.0]
