"""The benchmark of teams by their size: its missions, and what it makes of what it sees."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from benchmarks.report import marks
from benchmarks.run import Run
from benchmarks.scale import __main__ as scale
from benchmarks.scale import processes, raw, results, simulated
from mrbt_mesh.core.membership.envelope import parse_envelope
from mrbt_mesh.core.membership.wire import Header, read_heartbeat
from mrbt_mesh.formats.mission_file import load_mission, mission_warnings
from tests.support.paths import ROOT


def seen(*starts: tuple[str, str]) -> Run:
    """A run in which robots have started in areas, in this order."""
    events = [{"event": "start", "robot": robot, "args": [area]} for robot, area in starts]
    ended = {"event": "end", "robot": "R9", "args": ["a9"]}
    return cast(Run, SimpleNamespace(events=lambda: [*events, ended]))


@pytest.mark.parametrize("robots", [2, 6, 64])
def test_half_of_a_patrol_is_free(robots: int, tmp_path: Path) -> None:
    mission = load_mission(processes.write_mission(tmp_path, robots))
    assert len(mission.robots) == robots
    assert len([*mission.tree.actions()]) == robots // 2
    assert mission_warnings(mission) == []


def test_who_works_where() -> None:
    run = seen(("R1", "a1"), ("R2", "a2"), ("R3", "a1"))
    assert processes.workers(run) == {"a1": "R3", "a2": "R2"}


def test_a_team_of_one_is_refused() -> None:
    with pytest.raises(SystemExit, match="at least 2"):
        scale.measure(sizes=(6, 1))


def test_the_table_of_processes_has_a_row_for_each_team() -> None:
    slow = processes.Size(24, 7.25, 44.0, 52.0, 21.0, [80.0, None, 90.0])
    lines = results.of_processes([slow, processes.Size(64)]).splitlines()
    assert lines[2] == "| 24 | 7.2 | 44.0 | 52.0 | 21.0 | 85 | not in time |"
    assert lines[3].startswith("| 64 | not in time |")


@pytest.fixture(scope="module")
def team() -> simulated.Size:
    """A simulated team in which not everybody is everybody's neighbour."""
    return simulated.measure_size(12, 1)


def test_a_simulated_team_gets_over_all_that_befalls_it(team: simulated.Size) -> None:
    times_s = [team.launch_s, team.facts_s, team.late_s, team.cut_s, team.healed_s]
    assert all(each is not None for each in times_s)
    assert team.facts > simulated.FACTS_PER_ROBOT * team.robots
    assert {kind for kind, event in team.events.items() if event.replaced_s} == {
        "new plan",
        "kill",
        "freeze",
    }
    for event in team.events.values():
        assert all(after_s < 3 for after_s in event.replaced_s)
        assert 0 < event.most[0] < 200
        assert event.mean[0] <= event.most[0]


def test_simulated_teams_are_in_the_tables_and_the_picture(
    team: simulated.Size, tmp_path: Path
) -> None:
    late = simulated.Size(1_000, events={"kill": simulated.Event([9.0], [1.0], [1.0], [60.0])})
    text = results.of_simulated([team, late])
    assert len([line for line in text.splitlines() if line.startswith("| 12 |")]) == 3
    assert len([line for line in text.splitlines() if line.startswith("| 1000 |")]) == 2
    assert "| not in time / not in time |" in text
    results.draw([asdict(team), asdict(late)], tmp_path / "rest.png")
    assert (tmp_path / "rest.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["processes", "simulated"])
def test_the_page_has_a_place_for_what_is_measured(name: str) -> None:
    text = (ROOT / "docs" / "data" / "scale.md").read_text()
    assert [text.count(mark) for mark in marks(name)] == [1, 1]


def test_the_raw_team_sends_what_a_robot_with_these_neighbours_does() -> None:
    near = ("R001", "R002", "R003")
    envelope = parse_envelope(raw.heartbeat("R000", near))
    header = Header("0" * 16, "patrol", raw.RUN, "R000")
    beat = read_heartbeat("R000", envelope.data, header, lambda _: True)
    assert tuple(beat.relays) == near
    assert len(envelope.proof) == len(near) + 2  # and one more robot, and the operator
