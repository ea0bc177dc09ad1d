"""A recording on a page: held against a view of the team that was watched from the begin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mrbt_mesh.recording.folder import observer_file, robot_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, read_recording
from mrbt_mesh.sim import Kill
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.replay.shown_recording import ShownRecording
from tests.support.recorded import record_example

KILLED_US = 12_500_000
TIMELINE = ("work", "fault", "loss", "event", "why")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("shown")
    record_example(made, "vehicle_repair", 7, [(KILLED_US, Kill("A1"))])
    return made


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    return read_recording(observer_file(folder))


def shown_at(recording: Recording, at_us: int = 0) -> ShownRecording:
    shown = ShownRecording(Player(recording), at_us, 1.0)
    shown.update(at_us)
    return shown


def items_of(shown: ShownRecording, kinds: tuple[str, ...] | None = None) -> dict[str, Any]:
    found = shown.changes.since(0)
    return {k: v for k, v in found.items() if kinds is None or k.partition("/")[0] in kinds}


def watched_until(recording: Recording, at_us: int) -> dict[str, Any]:
    """What a page has that was open all the time, and looked after every step."""
    player = Player(recording)
    view = TeamView(player.observer)
    for each in sorted({record.at_us for record in recording.records if record.at_us <= at_us}):
        player.seek(each)
        view.update(each)
    return view.changes.since(0)


def without_agreement(items: dict[str, Any]) -> dict[str, Any]:
    """Since when somebody differs is known only to who looked then."""
    found = dict(items)
    for key in found:
        if key.startswith("robot/"):
            found[key] = {k: v for k, v in found[key].items() if k != "differs_since_s"}
    return found


@pytest.mark.slow
def test_the_whole_timeline_is_there_at_once(recording: Recording) -> None:
    shown = shown_at(recording)
    live = watched_until(recording, Player(recording).end_us)
    timeline = {k: v for k, v in live.items() if k.partition("/")[0] in TIMELINE}
    assert items_of(shown, TIMELINE) == timeline
    assert timeline["fault/0"]["robot"] == "A1"
    assert timeline["fault/0"]["taken_over_ms"] is not None
    assert "took over" in timeline["why/0"]["sentence"]


def test_the_timeline_of_a_long_recording_comes_bit_by_bit(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = items_of(shown_at(recording), TIMELINE)
    monkeypatch.setattr("mrbt_mesh.views.replay.shown_recording.FIRST_RECORDS", 10)
    shown = shown_at(recording)
    reached_s, known = [shown.read_s], [len(items_of(shown, TIMELINE))]
    while not shown.read(50):
        shown.update(0)
        playback = items_of(shown)["playback"]
        reached_s.append(playback["read_s"])
        known.append(len(items_of(shown, TIMELINE)))
    assert len(set(reached_s)) > 3
    assert reached_s == sorted(reached_s, key=lambda each: each or 0.0)
    assert known == sorted(known)
    assert known[0] < len(whole) // 4
    assert (shown.read_s, items_of(shown, TIMELINE)) == (None, whole)


@settings(
    max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=3))
def test_wherever_one_goes_the_team_is_as_it_was(recording: Recording, places: list[float]) -> None:
    """Also what pages are told as news leads there, and nothing of elsewhere remains."""
    shown = shown_at(recording)
    player = shown.playback.player
    page, version = items_of(shown), shown.changes.version
    for place in places:
        shown.playback.go_to(round(place * player.end_us))
        while not shown.step(7):
            pass
        shown.update(player.now_us)
        page |= shown.changes.since(version)
        version = shown.changes.version
    page = {key: value for key, value in page.items() if value is not None}
    assert page == items_of(shown)
    state = {k: v for k, v in page.items() if k.partition("/")[0] not in (*TIMELINE, "playback")}
    live = watched_until(recording, player.now_us)
    live = {k: v for k, v in live.items() if k.partition("/")[0] not in TIMELINE}
    assert without_agreement(state) == without_agreement(live)


def test_times_count_from_the_start_of_the_run(recording: Recording) -> None:
    shown = shown_at(recording)
    started_us = 0
    while shown.observer.record.started_us is None:
        started_us += 1_000
        shown.playback.go_to(started_us)
        shown.step(10**6)
    told = shown.to_json()
    assert told["from_s"] == -shown.observer.record.started_us / 1e6
    fault = items_of(shown)["fault/0"]
    shown.go_to(fault["at_s"])
    assert shown.playback.at_us == pytest.approx(KILLED_US, abs=100_000)
    assert shown.seconds(shown.playback.at_us) == fault["at_s"]


def test_it_pauses_at_the_end_and_begins_anew_from_there(recording: Recording) -> None:
    shown = shown_at(recording)
    playback = shown.playback
    shown.passed(10_000)
    assert (playback.is_at_end, playback.is_paused) == (True, True)
    shown.play(is_paused=False)
    assert (playback.at_us, playback.is_paused) == (playback.player.begin_us, False)
    shown.passed(1.0)
    shown.play(is_paused=True)
    shown.passed(1.0)
    assert playback.at_us == playback.player.begin_us + 1_000_000


def test_a_robots_own_recording_is_shown_too(folder: Path) -> None:
    shown = shown_at(read_recording(robot_file(folder, "B1")))
    assert shown.to_json()["robot"] == "B1"
    assert items_of(shown)["fault/0"]["robot"] == "A1"
