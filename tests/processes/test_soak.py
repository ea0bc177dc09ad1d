"""A team of real processes at work for many minutes: no errors, and nothing grows."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.support.effort import at_size
from tests.support.soak import write_mission
from tests.support.team import Team

SECONDS = at_size(quick=60, gate=600)
# Until then caches fill.
WARM_S = SECONDS / 5
SPEED = 20
MOST_GROWTH = 8 << 20
MOST_OF_A_FILE = 4 << 20


@pytest.mark.soak
@pytest.mark.timeout(SECONDS + 300)
def test_a_team_works_on_and_nothing_grows(team: Team, tmp_path: Path) -> None:
    team.up(write_mission(tmp_path, SPEED), speed=1, timeout_s=SECONDS + 240)
    team.wait_for_event("at_field", event="end", outcome="success")
    pause = threading.Event()
    pause.wait(WARM_S)
    before = _memory(team)
    pause.wait(SECONDS - WARM_S)
    after = _memory(team)
    status = team.status()
    assert status["failures"] == []
    assert {row["state"] for row in status["robots"].values()} == {"alive"}
    assert not any(row["problems"] for row in status["robots"].values())
    growth = {robot: after[robot] - before[robot] for robot in before}
    assert all(bytes_ < MOST_GROWTH for bytes_ in growth.values()), growth
    for robot in team.robots():
        bad = [row for row in team.log(robot) if row["level"] not in ("info", "debug")]
        assert [row for row in bad if not _is_of_the_machine(row)] == []
        assert (team.run_dir / f"{robot}.out").read_text() == ""
        for kind in ("log", "journal"):
            assert (team.run_dir / f"{robot}.{kind}").stat().st_size < MOST_OF_A_FILE
    ends = [event for event in team.events() if event["event"] == "end"]
    assert {event["outcome"] for event in ends} == {"success"}
    last_s = {e["robot"]: e["t"] for e in ends}
    assert min(last_s.values()) > time.time() - 60, last_s
    team.interrupt()


def _is_of_the_machine(row: dict[str, Any]) -> bool:
    """Whether a warning is about where the test runs: no keys, a disk or processors that others
    keep busy. A robot that is suspected is either heard again or declared dead.
    """
    is_expected = row["event"] in ("not_secure", "robot_suspect")
    return is_expected or "journal is slow" in row.get("problem", "")


def _memory(team: Team) -> dict[str, int]:
    """The bytes of each robot's process that are its own."""
    return {
        robot: psutil.Process(team.pid(robot)).memory_full_info().uss for robot in team.robots()
    }
