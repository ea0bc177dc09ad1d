"""An operator's client of the simulated team."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.observer.job_rows import JobRows
from mrbt_mesh.sim import (
    AgentOptions,
    Fault,
    Freeze,
    Kill,
    Restart,
    SimulationResult,
    simulate,
)
from mrbt_mesh.sim.world.team_commands import AbortMission, CancelJob, PauseTeam, Refusal, Submit
from tests.support.keys import keys_of
from tests.support.runs import example

S = 1_000_000
MISSION, PROGRAM = example("deliveries")
LOOK = Submit("inspect", ["shelf_5"], "one")


def given(*schedule: tuple[float, Fault], with_keys: bool = False) -> SimulationResult:
    keys = keys_of(*MISSION.robots, observer="watch")
    keys[""] = keys["watch"]
    return simulate(
        MISSION,
        PROGRAM,
        seed=1,
        schedule=[(round(at_s * S), step) for at_s, step in schedule],
        agents=AgentOptions(keys=keys if with_keys else {}),
        timeout_us=90 * S,
        until_jobs_end=True,
    )


@pytest.mark.parametrize("with_keys", [False, True])
def test_a_job_is_taken_and_a_change_of_it_refused(with_keys: bool) -> None:
    late = CancelJob("one")
    found = given((3, LOOK), (40, late), with_keys=with_keys)
    assert [(row.id, row.state, row.operator) for row in JobRows().of(found.observer)] == [
        ("one", "succeeded", "op")
    ]
    assert found.refusals == [Refusal(40 * S, late, "one has ended: succeeded")]
    assert found.duration_us < 41 * S


def test_the_run_goes_on_while_a_fault_a_job_or_an_answer_is_awaited() -> None:
    assert given((3, LOOK), (50, Restart("C1"))).duration_us >= 50 * S
    assert given((3, replace(LOOK, not_before_s=50))).duration_us >= 53 * S
    deaths = [(2.0, Kill(robot)) for robot in MISSION.robots]
    again = given(*deaths, (3, LOOK), (5, Restart("C1")))
    assert 13 * S <= again.duration_us < 20 * S
    assert [each.reason for each in again.refusals] == [
        "nothing was written: C1 would take it, and 4 robots are needed"
    ]


def test_a_frozen_robot_is_not_asked() -> None:
    found = given((2, Freeze("C1")), (2.1, LOOK))
    assert found.refusals == []
    assert found.duration_us < 40 * S


def test_a_command_when_the_mission_is_over() -> None:
    """Its robots are there for another moment."""
    found = given((3, AbortMission()), (3.1, PauseTeam()), (3.9, PauseTeam()))
    assert found.result == "failure"
    assert found.refusals == [Refusal(3_100_000, PauseTeam(), "the mission is over")]
    assert found.duration_us < 3.9 * S
