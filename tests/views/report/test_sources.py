"""The report of a run directory says what its summary and all its recordings say of the end."""

from __future__ import annotations

import fcntl
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.recording.folder import robot_file
from mrbt_mesh.sim import Kill
from mrbt_mesh.views.recordings.files import verified
from mrbt_mesh.views.replay.findings import RecordingFinding
from mrbt_mesh.views.report.model import NOT_KNOWN, RunReport
from mrbt_mesh.views.report.page import report_html
from mrbt_mesh.views.report.sources import read_report
from tests.support.recorded import record_example

ALL = ("R1", "R2")
AT_S = 1.5


@pytest.fixture
def killed(tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    """A run whose robots were all killed at once, so that none could notice."""
    folder = tmp_path / "run"
    faults = tuple((1_500_000, Kill(robot)) for robot in ALL)
    result = record_example(folder, "explore", 3, faults, timeout_us=4_000_000)
    assert result.summary["takeovers"] == []
    return folder, result.summary


def reported(folder: Path) -> tuple[RunReport, str]:
    found = read_report(folder, lambda path: verified((path,)))
    return found.runs[-1], report_html(found)


def told(summary: dict[str, Any]) -> dict[str, Any]:
    """The summary that `mrbt up` writes from the run's files."""
    takeover = {"detected_s": None, "reassigned_s": None, "exact": False, "held": None}
    fault = {"kind": "major", "at_s": AT_S, "until_s": None}
    return summary | {
        "result": "blocked",
        "robots": {robot: row | {"state": "dead"} for robot, row in summary["robots"].items()},
        "faults": [fault | {"robot": robot} for robot in ALL],
        "takeovers": [
            takeover | {"at_s": AT_S, "robot": robot, "replacement": None} for robot in ALL
        ],
    }


def test_deaths_that_nobody_saw_are_those_of_the_summary(
    killed: tuple[Path, dict[str, Any]],
) -> None:
    folder, summary = killed
    (folder / "summary.json").write_text(json.dumps(told(summary)))
    report, page = reported(folder)
    assert report.result == "blocked"
    died = {each.robot: each.at_s for each in report.deaths}
    assert died == {robot: pytest.approx(AT_S, abs=0.1) for robot in ALL}
    assert {each.state for each in report.robots} == {"dead"}
    assert all(each.present_s <= AT_S for each in report.robots)
    assert "No robot died" not in page


def test_a_run_that_an_operator_ended_is_ended(killed: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = killed
    (folder / "summary.json").write_text(json.dumps(summary | {"result": "ended"}))
    assert reported(folder)[0].result == "ended"


def test_a_summary_that_is_contradicted_counts_nothing(
    killed: tuple[Path, dict[str, Any]],
) -> None:
    folder, summary = killed
    (folder / "summary.json").write_text(json.dumps(told(summary) | {"global_tasks": {}}))
    forged = RecordingFinding("summary.json", 0, 0, "it is not what was signed")
    proof = replace(verified((folder,)), findings=(forged,))
    (report,) = read_report(folder, lambda _: proof).runs
    assert (report.result, report.deaths) == (NOT_KNOWN, [])


def test_without_a_summary_abrupt_ends_are_not_life(killed: tuple[Path, dict[str, Any]]) -> None:
    report, page = reported(killed[0])
    assert (report.result, {each.state for each in report.robots}) == (NOT_KNOWN, {NOT_KNOWN})
    assert "the recordings of R1, R2 end abruptly" in report.notes[-1]
    assert "No robot died" not in page
    assert "<b>2</b><i>robots whose end is not known" in page


def test_a_recording_that_is_still_written_ends_not_abruptly(
    killed: tuple[Path, dict[str, Any]],
) -> None:
    with robot_file(killed[0], "R1").open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        report, _ = reported(killed[0])
    states = {each.robot: each.state for each in report.robots}
    assert (states["R1"] == NOT_KNOWN, states["R2"]) == (False, NOT_KNOWN)
