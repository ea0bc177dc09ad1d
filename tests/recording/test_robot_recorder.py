"""What a robot records is what it knew, to the byte; and it records all of it in order."""

from __future__ import annotations

import hashlib
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.recording.channels import ACTIONS, FAULTS, LIFE
from mrbt_mesh.recording.folder import observer_file, robot_file
from mrbt_mesh.recording.reader import Recording, read_recording
from mrbt_mesh.recording.recorded_state import RecordedState, team_state
from mrbt_mesh.sim import AgentOptions, Kill, SimulationResult
from tests.support.recorded import record_example, state_text
from tests.support.runs import example


def at_the_end(recording: Recording) -> RecordedState:
    """What its owner knew after the last record."""
    mission = recording.metadata.read_mission("x")
    state = RecordedState(TeamFacts(mission, recording.metadata.run))
    for record in recording.records:
        state.apply(record)
    return state


@pytest.mark.slow
@pytest.mark.parametrize("plan_delay_us", [None, 3_000])
def test_the_last_state_is_that_of_the_live_robot_to_the_byte(
    tmp_path: Path, plan_delay_us: int | None
) -> None:
    options = AgentOptions(plan_delay_us=plan_delay_us)
    result = record_example(tmp_path, "vehicle_repair", 7, [(12_500_000, Kill("A1"))], options)
    assert result.agents.keys() >= {"A1", "B1", "C2"}
    for robot, agent in result.agents.items():
        live, state = agent.view, at_the_end(read_recording(robot_file(tmp_path, robot)))
        wanted = team_state(live.facts, live.alive(), state.plan)
        assert state_text(team_state(state.facts, state.alive, state.plan)) == state_text(wanted)
        assert live.plan is not None
        assert state.plan is not None
        hashed = hashlib.blake2b(live.plan.packed, digest_size=16).hexdigest()
        assert (state.plan["hash"], state.plan["digest"]) == (hashed, live.plan.digest.hex())
        assert state.statuses is not None
        told = [state.statuses[name] for name in ("T_i", "T_A", "T_G", "T_Li")]
        assert told == [status.name.lower() for status in live.statuses]


def test_the_last_state_is_that_of_the_observer(explored: tuple[Path, SimulationResult]) -> None:
    folder, result = explored
    state, live = at_the_end(read_recording(observer_file(folder))), result.observer
    wanted = team_state(live.facts, live.membership.members(), state.plan)
    assert state_text(team_state(state.facts, state.alive, state.plan)) == state_text(wanted)
    assert state.plan is not None
    assert live.plan is not None
    assert state.plan["digest"] == live.plan.digest.hex()
    assert state.robots.keys() == live.membership.peers.keys()


def test_every_action_of_a_robot_is_there_from_start_to_end(
    explored: tuple[Path, SimulationResult],
) -> None:
    folder, result = explored
    mission, _ = example("explore")
    for robot in mission.robots:
        records = read_recording(robot_file(folder, robot)).records
        told = [each.data for each in records if each.topic == ACTIONS]
        events = Counter(each["event"] for each in told)
        done = [each for each in result.events if each["robot"] == robot]
        assert events["started"] == events["finished"] == len(done) // 2
        for before, after in pairwise(told):
            if after["event"] != "started":
                assert before["ticket"] == after["ticket"]
        assert next(each.data["event"] for each in records if each.topic == LIFE) == "joined"


def test_a_death_is_told_by_those_who_saw_it(tmp_path: Path) -> None:
    record_example(tmp_path, "vehicle_repair", 7, [(12_500_000, Kill("A1"))])
    records = read_recording(robot_file(tmp_path, "B1")).records
    told = [r.data["event"] for r in records if r.topic == FAULTS and r.data["robot"] == "A1"]
    assert "token_lost" in told
    assert told[-1] == "dead"


def test_recording_changes_nothing(tmp_path: Path) -> None:
    from mrbt_mesh.sim import simulate

    mission, program = example("explore")
    without = simulate(mission, program, seed=3)
    assert record_example(tmp_path, "explore", 3).effect_log_digest == without.effect_log_digest
