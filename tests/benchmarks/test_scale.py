"""The benchmark of teams on one machine: its mission, and what it makes of what it sees."""

from __future__ import annotations

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from rich.console import Console

from benchmarks import scale
from benchmarks.run import Run
from mrbt_mesh.formats.mission_file import load_mission, mission_warnings


def seen(*starts: tuple[str, str]) -> Run:
    """A run in which robots have started in areas, in this order."""
    events = [{"event": "start", "robot": robot, "args": [area]} for robot, area in starts]
    ended = {"event": "end", "robot": "R9", "args": ["a9"]}
    return cast(Run, SimpleNamespace(events=lambda: [*events, ended]))


@pytest.mark.parametrize("robots", [2, 6, 64])
def test_half_of_a_patrol_is_free(robots: int, tmp_path: Path) -> None:
    file = tmp_path / "mission.yaml"
    file.write_text(scale.patrol(robots))
    mission = load_mission(file)
    assert len(mission.robots) == robots
    assert len([*mission.tree.actions()]) == robots // 2
    assert mission_warnings(mission) == []


def test_who_works_where() -> None:
    run = seen(("R1", "a1"), ("R2", "a2"), ("R3", "a1"))
    assert scale.workers(run) == {"a1": "R3", "a2": "R2"}


def test_what_did_not_come_in_time_is_told() -> None:
    late = scale.Size(64)
    slow = scale.Size(24, 7.25, 44.0, 52.0, 21.0, [80.0, None, 90.0])
    console = Console(width=120, record=True, file=None)
    with console.capture() as captured:
        console.print(scale.table([slow, late]))
    lines = captured.get().splitlines()
    assert lines[2].split() == ["24", "7.2", "44.0", "52.0", "21.0", "85", ">", "60", "s"]
    assert lines[3].split() == ["64", "not", "in", "time"]


def test_a_team_of_one_is_refused() -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="at least 2"):
        scale.sizes_of("6,1")
    assert scale.sizes_of("6,12") == [6, 12]
