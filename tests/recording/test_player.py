"""Seeking in a recording: any way to a time leads to the same state."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.recording.folder import observer_file, robot_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import (
    Recording,
    RecordingError,
    open_recording,
    parse_recording,
    read_recording,
)
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import Kill, Restart, Schedule, SimulationResult, simulate
from tests.support.paths import EXAMPLES
from tests.support.recorded import record_example, state_text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which a robot dies at work."""
    made = tmp_path_factory.mktemp("played")
    record_example(made, "vehicle_repair", 7, [(12_500_000, Kill("A1"))])
    return made


@pytest.fixture(scope="module")
def watched(folder: Path) -> Recording:
    return read_recording(observer_file(folder))


@pytest.mark.slow
@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(0, 1), min_size=1, max_size=4))
def test_any_way_leads_to_the_same_state(watched: Recording, places: list[float]) -> None:
    player = Player(watched)
    length_us = player.end_us - player.begin_us
    for place in places:
        player.seek(player.begin_us + round(place * length_us))
    fresh = Player(watched)
    fresh.seek(player.now_us)
    assert state_text(player.state.to_json()) == state_text(fresh.state.to_json())
    assert list(player.observer.record.timeline) == list(fresh.observer.record.timeline)


@pytest.mark.parametrize("whose", ["", "B1"])
def test_the_robots_that_count_are_those_of_the_plan(folder: Path, whose: str) -> None:
    path = robot_file(folder, whose) if whose else observer_file(folder)
    player, plan, reasons = Player(open_recording(path)), None, set[str]()
    for _ in player.play_to(player.end_us):
        observer = player.observer
        if observer.plan is not plan and observer.plan is not None:
            plan = observer.plan
            assert observer.membership.members() == player.state.alive
            reasons |= {*observer.idle.values()}
    assert "nothing it can do is needed now" in reasons
    # Robots are described by their facts before plans count on them.
    assert "what it can do is not known yet" not in reasons


@pytest.mark.parametrize("whose", ["", "B1"])
def test_what_was_long_before_is_skipped(
    folder: Path, whose: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mrbt_mesh.recording.player.PLAYED_RECORDS", 5)
    path = robot_file(folder, whose) if whose else observer_file(folder)
    player, whole = Player(open_recording(path)), Player(read_recording(path))
    whole.seek(whole.end_us)
    length_us = whole.end_us - whole.begin_us
    for place in (0.5, 0.9, 0.1, 1.0, 0.7):
        at_us, played = whole.begin_us + round(place * length_us), 0
        for _ in player.play_to(at_us, skips=True):
            played += 1
        whole.seek(at_us)
        assert state_text(player.state.to_json()) == state_text(whole.state.to_json())
        assert player.observer.plan == whole.observer.plan
        states = [
            (each.robots(), [each.robot_state(robot) for robot in each.robots()])
            for each in (player.observer, whole.observer)
        ]
        assert states[0] == states[1]
        assert player.observer.record.result is whole.observer.record.result
        assert played < len(whole.recording.records) // 3


def test_before_and_after_a_death(folder: Path, watched: Recording) -> None:
    for recording in (watched, read_recording(robot_file(folder, "B1"))):
        player = Player(recording)
        player.seek(12_400_000)
        assert player.observer.robot_state("A1") is State.ALIVE
        claim = player.observer.claim("A1")
        assert claim is not None
        player.seek(13_000_000)
        assert player.observer.robot_state("A1") is State.DEAD
        assert player.observer.claim("A1") is None
        (fault,) = player.observer.record.major
        assert (fault.robot, fault.replacement) == ("A1", "B1")
        player.seek(player.end_us)
        assert player.observer.record.result is Status.SUCCESS


def test_each_life_of_a_robot_has_a_death_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where nothing shows that the next life was heard but that it has joined."""
    lives = [(4.0, Kill("C1")), (6.0, Restart("C1")), (9.0, Kill("C1"))]
    record_example(tmp_path, "vehicle_repair", 1, [(round(s * 1e6), f) for s, f in lives])
    missing = Player._missing

    def only_losses(player: Player, data: Mapping[str, Any], at_us: int) -> None:
        if data["event"] not in ("token_shown", "alive"):
            missing(player, data, at_us)

    monkeypatch.setattr(Player, "_missing", only_losses)
    player = Player(read_recording(robot_file(tmp_path, "C2")))
    player.seek(player.end_us)
    deaths_s = [fault.at_us / 1e6 for fault in player.observer.record.major]
    assert deaths_s == [pytest.approx(4, abs=0.1), pytest.approx(9, abs=0.1)]


def test_a_robot_that_others_held_for_dead_before_it_was_heard_took_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The observer knew it by its facts and by its death alone, and counted its work."""
    result = record_example(tmp_path, "explore", 3, [(1_500_000, Kill("R1"))])
    robot, fault = Player._robot, Player._fault

    def of_others(player: Player, name: str, data: Mapping[str, Any], at_us: int) -> None:
        if name != "R1":
            robot(player, name, data, at_us)

    def faults_of_others(player: Player, data: Mapping[str, Any], at_us: int) -> None:
        if data["robot"] != "R1":
            fault(player, data, at_us)

    monkeypatch.setattr(Player, "_robot", of_others)
    monkeypatch.setattr(Player, "_fault", faults_of_others)
    player = Player(read_recording(observer_file(tmp_path)))
    player.seek(player.end_us)
    assert player.summary()["global_tasks"] == result.summary["global_tasks"]
    assert [each.robot for each in player.observer.record.major] == ["R1"]


def recorded(folder: Path, mission: str, schedule: Schedule, seconds: int) -> SimulationResult:
    read = load_mission(EXAMPLES / mission)
    program = load_program(read.program or "")
    timeout_us = seconds * 1_000_000
    return simulate(read, program, seed=3, schedule=schedule, record=folder, timeout_us=timeout_us)


@pytest.mark.slow
@pytest.mark.parametrize("whose", ["", "B1"])
def test_the_rounds_of_a_mission_that_never_ends(
    tmp_path_factory: pytest.TempPathFactory, whose: str
) -> None:
    folder = tmp_path_factory.mktemp("rounds")
    result = recorded(folder, "vehicle_repair/standing_by.yaml", [], 32)
    path = robot_file(folder, whose) if whose else observer_file(folder)
    player = Player(read_recording(path))
    player.seek(player.end_us)
    summary = player.summary()
    assert summary["result"] == result.summary["result"] == "success"
    assert len(summary["rounds"]) == 2
    for found, live in zip(summary["rounds"], result.summary["rounds"], strict=True):
        assert (found["result"], found["robots"]) == (live["result"], live["robots"])
        assert found["from_s"] == pytest.approx(live["from_s"], abs=0.05)


def test_a_team_that_is_dead_to_the_last_robot_is_blocked(tmp_path: Path) -> None:
    schedule: Schedule = [(2_000_000, Kill("R1")), (2_000_000, Kill("R2"))]
    result = recorded(tmp_path, "explore/mission.yaml", [*schedule, (50_000_000, Restart("R1"))], 9)
    player = Player(read_recording(observer_file(tmp_path)))
    player.seek(player.end_us)
    assert player.observer.robot_state("R1") is State.DEAD
    assert player.summary()["result"] == result.summary["result"] == "blocked"


def test_a_damaged_recording_is_refused(watched: Recording) -> None:
    content = bytearray(watched.path.read_bytes())
    content[content.index(b'"lines"') + 20] ^= 1
    with pytest.raises(
        RecordingError, match=r"run\.mcap: record \d+: .* see `mrbt recording verify`"
    ):
        Player(parse_recording(bytes(content), watched.path))
