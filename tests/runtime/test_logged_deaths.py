"""The times of deaths, from robots' logs."""

from __future__ import annotations

import json
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.observer.episodes import DeathTimes, MajorFault
from mrbt_mesh.runtime.logged_deaths import LoggedDeaths
from mrbt_mesh.runtime.run_dir import RunDir

NOW_US, UNIX_S = 50_000_000, 1_800_000_000
CLAIM = Claim("act", "repair", "weld", Phase.RUNNING, 1, "")
LIFE = Incarnation(1, "n")


@pytest.fixture(autouse=True)
def unix_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """`time.time` stands still: NOW_US on the observer's clock."""
    monkeypatch.setattr(time, "time", lambda: UNIX_S)


def fault(exact: bool) -> MajorFault:
    return MajorFault(*("A", LIFE, 40_000_000, CLAIM, 40_100_000, 40_200_000, "B"), exact=exact)


def log(folder: Path, robot: str, *rows: tuple[int, dict[str, str]]) -> None:
    """The log of a robot: lines with their times on the observer's clock."""
    lines = []
    for at_us, row in rows:
        unix_s = UNIX_S + (at_us - NOW_US) / 1e6
        lines.append(
            json.dumps(row | {"timestamp": datetime.fromtimestamp(unix_s, UTC).isoformat()})
        )
    (folder / f"{robot}.log").write_text("\n".join([*lines, '{"event": "robot_dead", "ro']))


def times_of(folder: Path, fault: MajorFault) -> DeathTimes:
    logged = LoggedDeaths(RunDir(folder))
    logged.look()
    return logged.times_of(fault, NOW_US)


def test_robots_logs_have_the_times(tmp_path: Path) -> None:
    start = {"event": "local_task_started", "activation": "act", "local_task": "weld"}
    log(
        tmp_path,
        "B",
        (30_000_000, {"event": "robot_dead", "robot": "A"}),
        (40_020_000, {"event": "robot_dead", "robot": "A"}),
        (40_030_000, start | {"activation": "other"}),
        (40_040_000, start),
    )
    log(
        tmp_path,
        "C",
        (39_990_000, {"event": "robot_suspect", "robot": "A"}),
        (40_010_000, {"event": "robot_dead", "robot": "A"}),
        (40_011_000, {"event": "robot_dead", "robot": "D"}),
        (40_012_000, start),
    )
    found = times_of(tmp_path, fault(exact=True))
    assert [found.at_us, found.detected_us] == [39_990_000, 40_010_000]
    assert found.reassigned_us == 40_040_000
    found = times_of(tmp_path, fault(exact=False))
    assert found.at_us == 40_000_000, "the last sign of life stays what it is"


def test_what_no_robot_logged_is_as_it_was_heard(tmp_path: Path) -> None:
    found = times_of(tmp_path, fault(exact=True))
    assert found == DeathTimes(40_000_000, 40_100_000, 40_200_000, "B", exact=True)


def test_logs_are_read_as_they_grow_and_damaged_lines_are_passed_over(tmp_path: Path) -> None:
    logged = LoggedDeaths(RunDir(tmp_path))
    logged.look()
    log(tmp_path, "B", (40_010_000, {"event": "robot_dead", "robot": "A"}))
    with (tmp_path / "B.log").open("a") as file:
        file.write('\n{"event": "robot_dead"}\n[]\n')
    logged.look()
    found = logged.times_of(fault(exact=True), NOW_US)
    assert found.detected_us == 40_010_000
