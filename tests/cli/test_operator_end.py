"""A run that an operator has ended is ended by him, whatever was in the way before."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.cli.operator_end import with_operator_end
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.runtime.command_log import last_end, note_command, team_ends
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.run_dir import COMMANDS_FILE, RunDir
from tests.support.paths import mission_file

SECOND_US = 1_000_000
BEGAN_S = 100.0
STOPPED = "stopped by the operator"


@pytest.fixture
def record() -> RunRecord:
    """Of a run that began some time ago."""
    found = RunRecord(load_mission(mission_file("explore")))
    found.started_us = boottime_us() - round(BEGAN_S * SECOND_US)
    return found


def episode(request: str, ago_s: float, to_ago_s: float | None = None) -> dict[str, Any]:
    to_s = None if to_ago_s is None else BEGAN_S - to_ago_s
    return {"request": request, "reason": "blocked", "from": BEGAN_S - ago_s, "to": to_s}


def blocked(summary: dict[str, Any]) -> list[str]:
    return [each["request"] for each in summary["blocked"]]


@pytest.mark.parametrize(
    ("before", "result"),
    [("blocked", "ended"), ("timeout", "ended")]
    + [(each, each) for each in ("success", "failure", "not_started")],
)
def test_a_run_that_was_blocked_or_on_its_way_is_ended(
    record: RunRecord, before: str, result: str
) -> None:
    summary = {"result": before, "blocked": [episode("in doubt", 60)]}
    found = with_operator_end(summary, record, None, STOPPED)
    assert (found["result"], found["ended_because"]) == (result, STOPPED)
    assert blocked(found) == ["in doubt"], "that is said all the same"


def test_what_robots_that_leave_leave_undone_was_not_blocked(
    record: RunRecord, tmp_path: Path
) -> None:
    """Also where the run was ended before, and has gone on."""
    run_dir, now_s = RunDir(tmp_path), time.time()
    note_command(run_dir, "mrbt down", "ended by anna", now_s - 50)
    note_command(run_dir, "mrbt up --continue", "the team goes on", now_s - 40)
    note_command(run_dir, "mrbt down", "ended by anna", now_s - 10)
    episodes = [
        episode("before", 60, 45),
        episode("first end", 49.9, 39),
        episode("on its way", 30),
        episode("last end", 9.9),
    ]
    found = with_operator_end({"result": "blocked", "blocked": episodes}, record, run_dir, "")
    assert (found["result"], found["ended_because"]) == ("ended", "ended by anna")
    assert blocked(found) == ["before", "on its way"]


def test_nobody_has_ended_it(record: RunRecord) -> None:
    summary = {"result": "blocked", "blocked": [episode("why", 0)]}
    assert with_operator_end(summary, record, None, "") == summary


def test_a_file_of_commands_that_is_empty_names_no_end(tmp_path: Path) -> None:
    """On a full disk a command could not be noted."""
    (tmp_path / COMMANDS_FILE).touch()
    assert (team_ends(RunDir(tmp_path)), last_end(RunDir(tmp_path))) == ([], None)
