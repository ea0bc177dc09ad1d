"""Missions that never end: the paper's vehicle from one damage to the next, also under faults."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import (
    ChangePerformance,
    Fault,
    Kill,
    Leave,
    Restart,
    SimulationResult,
    simulate,
)
from mrbt_mesh.sim.world.faults import Operate
from tests.support.effort import seeds
from tests.support.paths import EXAMPLES

S = 1_000_000
SPOILT = ("damaged", "broken")
MISSION = load_mission(EXAMPLES / "vehicle_repair" / "standing_by.yaml")


def run(*schedule: tuple[float, Fault], seconds: float = 90, seed: int = 1) -> SimulationResult:
    assert MISSION.program is not None
    steps = [(round(at_s * S), fault) for at_s, fault in schedule]
    program = load_program(MISSION.program)
    result = simulate(MISSION, program, seed=seed, schedule=steps, timeout_us=round(seconds * S))
    assert result.violations == [], f"seed {seed}"
    return result


def told(result: SimulationResult) -> list[tuple[int, str | None]]:
    """(second of the beginning, result) of each round."""
    rounds: list[dict[str, Any]] = result.summary["rounds"]
    return [(round(each["from_s"]), each["result"]) for each in rounds]


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(5))
def test_three_damages_three_rounds(seed: int) -> None:
    result = run(seed=seed)
    assert told(result) == [(4, "success"), (30, "success"), (56, "success")]
    assert result.result == "success"
    assert result.stops == {}, "nobody stops by itself"
    assert {t["status"] for t in result.summary["global_tasks"].values()} == {"success"}
    screws = [e for e in result.events if e["global_task"] == "place_screws"]
    assert len({e["activation"] for e in screws}) == 3, "each round has work of its own"


@pytest.mark.slow
def test_the_rounds_work_is_that_of_what_broke() -> None:
    ends = [e for e in run().events if e["event"] == "end" and e["local_task"] == "replace_hw"]
    parts = [part for e in ends for part in e["args"]]
    assert [sorted(parts[:2]), parts[2:3], sorted(parts[3:])] == [["2", "4"], ["1"], ["3", "5"]]


@pytest.mark.slow
def test_time_is_up_in_the_middle_of_a_round() -> None:
    result = run(seconds=40)
    assert told(result) == [(4, "success"), (30, None)]
    assert result.result == "success", "the last round that has ended was one"
    assert run(seconds=20).result == "timeout", "not one round has ended"
    assert run(seconds=3).result == "success", "the vehicle is in order"


@pytest.mark.slow
def test_faults_while_the_team_rests_and_while_it_works() -> None:
    """A2 dies at rest, B1 at work; later B1 is back, and A1 is bad at what it did best."""
    result = run(
        (2, Kill("A2")),
        (16, Kill("B1")),
        (29, Restart("B1")),
        (29, ChangePerformance("A1", "replace_hw", S // 2)),
        seconds=110,
    )
    assert [fault["robot"] for fault in result.summary["faults"]] == ["A2", "B1"]
    assert {r for _, r in told(result)} == {"success"}
    assert len(told(result)) >= 3
    facts = result.observer.facts
    assert facts.condition("nominal")
    assert not any(facts.condition(f"{name}({part})") for name in SPOILT for part in range(1, 6))
    fixed = [e for e in result.events if e["local_task"] == "replace_hw" and e["event"] == "end"]
    assert {e["args"][0] for e in fixed} == {"1", "2", "3", "4", "5"}


def test_a_damage_in_the_middle_of_a_repair_is_the_next_round() -> None:
    """With two robots less the second damage comes before the first one is repaired."""
    result = run((2, Kill("A1")), (2, Kill("A2")), (2, Kill("B1")), seconds=150)
    (first, second, *_) = result.summary["rounds"]
    assert first["to_s"] > 31
    assert second["from_s"] - first["to_s"] < 0.3
    assert {r for _, r in told(result)} == {"success"}


def test_a_team_that_cannot_repair_the_next_damage_is_blocked() -> None:
    result = run((28.5, Kill("C2")), seconds=60)
    assert told(result) == [(4, "success"), (30, None)]
    assert result.result == "blocked"


@pytest.mark.slow
def test_who_leaves_while_the_team_stands_by_does_not_end_it() -> None:
    result = run((29, Leave("A2")))
    assert [r for _, r in told(result)] == ["success"] * 3
    assert result.stops.keys() == {"A2"}


def test_an_abort_ends_it() -> None:
    result = run((40, Operate("B2", "aborted", True)))
    assert (result.result, result.duration_us // S) == ("failure", 40)
    assert result.stops.keys() == set(MISSION.robots)
