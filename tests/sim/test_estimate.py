"""Experiments: the same figures whatever the number of processes, and what they say."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

import pytest

from mrbt_mesh.core.mission.mission import Mission, performance
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim import simulate
from mrbt_mesh.sim.estimate import (
    NETWORK,
    Experiment,
    Point,
    RunOutcome,
    outcomes,
    percentile,
    run_one,
    summarise,
    wilson,
)
from mrbt_mesh.sim.parallel import spread
from mrbt_mesh.sim.statistics.sweeps import SweepError, parse_rates, parse_sweep, points_of
from mrbt_mesh.sim.statistics.team_sizes import resized
from mrbt_mesh.sim.world.failures import EVERYBODY, FailureModel, Rate
from tests.support.effort import IS_LONG
from tests.support.runs import EXAMPLES

REPAIR = str(EXAMPLES / "vehicle_repair" / "mission.yaml")
EXPLORE = str(EXAMPLES / "explore" / "mission.yaml")


def experiment(mission: str, runs: int, *points: Point) -> Experiment:
    program = load_mission(mission).program
    assert program is not None
    return Experiment(mission, program, points, runs)


@pytest.fixture(scope="module")
def repair() -> Mission:
    return load_mission(REPAIR)


# -- reproducible -----------------------------------------------------------------------------


def test_the_same_figures_whatever_the_number_of_processes() -> None:
    shaky = FailureModel(major={EVERYBODY: Rate(per_action=0.2)}, minor_faults=1)
    what = experiment(EXPLORE, 9, Point(FailureModel()), Point(shaky))
    alone = list(outcomes(what, 1))
    together = list(outcomes(what, 2))
    assert sorted(alone, key=repr) == sorted(together, key=repr)
    texts = [json.dumps([s.to_json() for s in summarise(what, o)]) for o in (alone, together)]
    assert texts[0] == texts[1]


def test_a_run_can_be_looked_at_with_its_seed_alone() -> None:
    what = experiment(REPAIR, 1, Point(FailureModel()))
    mission = load_mission(REPAIR)
    from mrbt_mesh.runtime.program_loader import load_program

    single = simulate(mission, load_program(what.program), seed=what.seed_of(7), network=NETWORK)
    assert run_one(what, what.points[0], 7).summary == single.summary
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
    what = experiment(EXPLORE, 4, Point(FailureModel()))
    found = [
        RunOutcome(0, 3, "blocked", 60_000_000, 2, 0),
        RunOutcome(0, 0, "success", 10_000_000, 0, 0),
        RunOutcome(0, 1, "success", 20_000_000, 1, 0),
        RunOutcome(0, 2, "success", 12_000_000, 0, 0),
    ]
    (summary,) = summarise(what, found)
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
    nothing = summarise(what, found[:1])[0].to_json()
    assert nothing["duration_s"] is None
    assert nothing["success"]["probability"] == 0


def test_more_faults_never_make_the_repair_more_likely() -> None:
    """Common seeds: the first k faults of a run are the same, so success can only be lost."""
    points = [Point(FailureModel(major_faults=number)) for number in range(4)]
    what = experiment(REPAIR, 5 if IS_LONG else 2, *points)
    summaries = summarise(what, list(outcomes(what, 1)))
    chances = [summary.probability for summary in summaries]
    assert chances[0] == 1.0
    assert chances == sorted(chances, reverse=True)
    assert [summary.major_faults for summary in summaries][:2] == [0.0, 1.0]


# -- teams of other sizes ---------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 6, 7, 12])
def test_a_team_of_any_size_has_all_types_and_can_do_everything(repair: Mission, size: int) -> None:
    team = resized(repair, size)
    assert len(team.robots) == size
    assert all(name == robot.id for name, robot in team.robots.items())
    types = {part for robot in team.robots.values() for part in robot.type.split("-")}
    assert types == {"A", "B", "C"}
    for task in team.global_tasks.values():
        for need in task.needs:
            able = [r for r in team.robots.values() if performance(r.capabilities, need.local_task)]
            assert len(able) >= need.min_robots >= 1


def test_how_teams_are_formed(repair: Mission) -> None:
    assert resized(repair, 6) is repair
    assert sorted(resized(repair, 2).robots) == ["A1-B1-C1", "A2-B2-C2"]
    one = resized(repair, 1)
    (robot,) = one.robots.values()
    assert robot.capabilities["do_diagnosis"] == 3_000_000  # A's, better than B's
    assert one.global_tasks["remove_cover"].needs[0].min_robots == 1
    assert resized(repair, 2).global_tasks["remove_cover"].needs[0].min_robots == 2
    assert {"A1", "A1-2", "C2-2"} < set(resized(repair, 12).robots)
    for size in (0, 100_000):
        with pytest.raises(ValueError, match="robots, not"):
            resized(repair, size)


def test_ids_of_large_unions_stay_ids(repair: Mission) -> None:
    crowd = resized(repair, 60)
    assert sorted(resized(crowd, 2).robots) == ["R1", "R2"]


# -- sweeps -----------------------------------------------------------------------------------


def test_sweeps_are_lists_or_ranges() -> None:
    assert parse_sweep("major=0:3") == ("major", ["0", "1", "2", "3"])
    rates = ["0/hour", "0.1/hour", "0.2/hour", "0.3/hour"]
    assert parse_sweep("fault-rate=0:0.3:0.1/hour") == ("fault-rate", rates)
    assert parse_sweep("robots=1,2, 4") == ("robots", ["1", "2", "4"])


def test_two_sweeps_make_a_grid_without_what_is_impossible(repair: Mission) -> None:
    points = points_of(repair, FailureModel(), None, ["major=0:2", "robots=1,6"])
    assert [point.values for point in points] == [
        (("major", "0"), ("robots", "1")),
        (("major", "1"), ("robots", "1")),
        (("major", "0"), ("robots", "6")),
        (("major", "1"), ("robots", "6")),
        (("major", "2"), ("robots", "6")),
    ]
    assert [point.failures.major_faults for point in points] == [0, 1, 0, 1, 2]
    assert [point.robots for point in points] == [1, 1, 6, 6, 6]


def test_rates_of_a_robot_a_type_and_everybody(repair: Mission) -> None:
    rates = parse_rates("fault-rate", ["0.1", "A:2/hour", "A:0.5/action", "C1:0"], repair)
    assert rates == {"": Rate(0.1), "A": Rate(0.5, 2.0), "C1": Rate()}


@pytest.mark.parametrize(
    "text",
    [
        *("major", "speed=1", "major=1.5", "major=-1", "major=3:1", "major=x", "major=0:1e9"),
        *("major=7", "minor=0:9:0", "robots=0", "robots=5000"),
        *("fault-rate=2", "fault-rate=0.1/day"),
    ],
)
def test_sweeps_that_make_no_sense(repair: Mission, text: str) -> None:
    with pytest.raises(SweepError):
        points_of(repair, FailureModel(), None, [text])


def test_at_most_two_sweeps_of_different_names(repair: Mission) -> None:
    for texts in (["major=1", "major=2"], ["major=1", "minor=1", "robots=2"]):
        with pytest.raises(SweepError, match="at most two"):
            points_of(repair, FailureModel(), None, texts)
