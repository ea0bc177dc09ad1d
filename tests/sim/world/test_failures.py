"""Failure models: what befalls the team, how often, and all from the seed."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.sim import SimulationResult, simulate
from mrbt_mesh.sim.world.setup import EVERYBODY, FailureModel, Rate, rate_of
from tests.support.effort import seeds
from tests.support.runs import example

SECOND_US = 1_000_000


def run(model: FailureModel, seed: int = 0, **options: Any) -> SimulationResult:
    mission, program = example("vehicle_repair")
    return simulate(mission, program, seed=seed, failures=model, stop_when_stuck=True, **options)


def test_the_most_specific_rate_counts() -> None:
    mission, _ = example("vehicle_repair")
    rates = {EVERYBODY: Rate(0.1), "A": Rate(0.2), "A1": Rate(per_hour=3)}
    found = {name: rate_of(rates, robot) for name, robot in mission.robots.items()}
    assert found["A1"] == Rate(per_hour=3)
    assert found["A2"] == Rate(0.2)
    assert found["C1"] == Rate(0.1)
    assert rate_of({"A": Rate(0.2)}, mission.robots["C1"]) == Rate()


def test_who_dies_after_an_action_has_told_its_outcome() -> None:
    """With certainty: every robot ends exactly one action, and each outcome is known to others."""
    result = run(FailureModel(major={EVERYBODY: Rate(per_action=1.0)}))
    ends = [event["robot"] for event in result.events if event["event"] == "end"]
    assert sorted(ends) == sorted(set(ends))
    assert result.fault_counts == {"Kill": len(ends)}
    told = {entry.author for entry in result.observer.facts.map if "outcome/" in entry.name}
    assert told == set(ends)
    assert result.result == "blocked"
    assert result.violations == []


def test_a_type_or_a_robot_may_be_the_only_ones_to_fail() -> None:
    result = run(FailureModel(major={"C": Rate(per_action=1.0)}))
    assert {fault["robot"] for fault in result.summary["faults"]} <= {"C1", "C2"}
    assert result.fault_counts["Kill"] == 2


def test_the_dead_return_and_what_is_lost_is_repaired() -> None:
    """Hardly anything is left to do without them, so the mission only succeeds if they do."""
    lasting = FailureModel(major={"C": Rate(per_action=1.0)}, minor={"B": Rate(per_action=1.0)})
    passing = FailureModel(
        lasting.major, lasting.minor, return_us=2 * SECOND_US, repair_us=3 * SECOND_US
    )
    assert run(lasting).result == "blocked"
    result = run(passing)
    assert result.result == "success", result.summary["blocked"]
    assert result.fault_counts["Restart"] >= 2
    assert result.fault_counts["Restore"] >= 1


@pytest.mark.slow
def test_failures_per_hour_are_as_frequent_as_they_say() -> None:
    """Robots without work and without end: deaths in an hour are Poisson distributed.

    With rate lambda = 200 per hour and T = 10 s, each of 6 robots dies with probability
    1 - exp(-lambda T) = 0.426; 40 runs: Bin(240, 0.426) is in 73..132 with 99.99 %.
    """
    model = FailureModel(major={EVERYBODY: Rate(per_hour=200)})
    deaths = 0
    for seed in range(40):
        mission, program = example("vehicle_repair")
        result = simulate(
            mission,
            program,
            seed=seed,
            failures=model,
            timeout_us=10 * SECOND_US,
            speed=0.01,
            inspect=False,
        )
        deaths += result.fault_counts.get("Kill", 0)
    assert 73 <= deaths <= 132


def test_an_action_that_fails_by_chance_sets_no_conditions() -> None:
    result = run(FailureModel(actions={"do_diagnosis": 1.0}))
    assert result.result == "failure"
    assert not [text for _, text in result.observer.record.timeline if "is true" in text]
    diagnosed = [text for _, text in result.observer.record.timeline if "diagnosis" in text]
    assert any("failed" in text for text in diagnosed)


def test_a_run_of_which_nothing_more_will_come_is_ended_early() -> None:
    model = FailureModel(major={"C": Rate(per_action=1.0)})
    early = run(model)
    mission, program = example("vehicle_repair")
    late = simulate(
        mission, program, seed=0, failures=model, inspect=False, timeout_us=90 * SECOND_US
    )
    assert early.result == late.result == "blocked"
    assert early.duration_us < 30 * SECOND_US < late.duration_us
    assert early.summary["global_tasks"] == late.summary["global_tasks"]


@pytest.mark.parametrize("seed", seeds(6))
def test_ending_early_ends_nothing_that_would_have_gone_on(seed: int) -> None:
    """Rates that leave some runs blocked: the verdict is the same with all the time there is."""
    model = FailureModel(
        major={EVERYBODY: Rate(per_action=0.1)}, return_us=10 * SECOND_US, repair_us=SECOND_US
    )
    mission, program = example("vehicle_repair")
    late = simulate(mission, program, seed=seed, failures=model, inspect=False)
    assert run(model, seed).result == late.result
