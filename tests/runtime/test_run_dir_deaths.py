"""The times of deaths in a run directory: from robots' logs, and for other observers."""

from __future__ import annotations

import json
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.observer.episodes import DeathTimes, MajorFault
from mrbt_mesh.runtime.run_dir import RunDir

NOW_US = 50_000_000
CLAIM = Claim("act", "repair", "weld", Phase.RUNNING, 1, "")
LIFE = Incarnation(1, "n")


def fault(exact: bool) -> MajorFault:
    return MajorFault(*("A", LIFE, 40_000_000, CLAIM, 40_100_000, 40_200_000, "B"), exact=exact)


def log(folder: Path, robot: str, *rows: tuple[int, dict[str, str]]) -> None:
    """The log of a robot: lines with their times on the observer's clock."""
    lines = []
    for at_us, row in rows:
        unix_s = time.time() + (at_us - NOW_US) / 1e6
        lines.append(
            json.dumps(row | {"timestamp": datetime.fromtimestamp(unix_s, UTC).isoformat()})
        )
    (folder / f"{robot}.log").write_text("\n".join([*lines, '{"event": "robot_dead", "ro']))


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
    near = [pytest.approx(us, abs=5_000) for us in (39_990_000, 40_010_000, 40_040_000)]
    found = RunDir(tmp_path).logged_times(fault(exact=True), NOW_US)
    assert [found.at_us, found.detected_us, found.reassigned_us] == near
    found = RunDir(tmp_path).logged_times(fault(exact=False), NOW_US)
    assert found.at_us == 40_000_000, "the last sign of life stays what it is"


def test_what_no_robot_logged_is_as_it_was_heard(tmp_path: Path) -> None:
    found = RunDir(tmp_path).logged_times(fault(exact=True), NOW_US)
    assert found == DeathTimes(40_000_000, 40_100_000, 40_200_000, "B", exact=True)


def test_another_observer_reads_what_was_written(tmp_path: Path) -> None:
    run_dir = RunDir(tmp_path)
    assert run_dir.deaths(NOW_US) == []
    run_dir.write_deaths([fault(exact=True)], NOW_US)
    ((robot, incarnation, times),) = run_dir.deaths(NOW_US)
    assert (robot, incarnation, times.replacement, times.exact) == ("A", LIFE, "B", True)
    assert times.at_us == pytest.approx(40_000_000, abs=100_000)
    assert (times.detected_us or 0) - times.at_us == 100_000
    (tmp_path / "deaths.json").write_text('{"deaths": [')
    assert run_dir.deaths(NOW_US) == [], "damaged"
