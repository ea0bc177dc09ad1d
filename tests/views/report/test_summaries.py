"""Figures of a summary, on hand-written cases."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.views.report.model import spread
from mrbt_mesh.views.report.summaries import report_summary

TAKEOVER: dict[str, Any] = {
    "robot": "A1",
    "at_s": 2.0,
    "detected_s": 0.25,
    "reassigned_s": None,
    "held": "scan",
    "replacement": None,
    "exact": True,
}
SUMMARY: dict[str, Any] = {
    "mission": "explore",
    "result": "blocked",
    "duration_s": 9.5,
    "robots": {"A1": {"type": "A", "state": "dead"}, "B1": {"type": "B", "state": "alive"}},
    "global_tasks": {"look": {"status": "running", "robots": ["A1"]}},
    "faults": [
        {"kind": "major", "robot": "A1", "at_s": 2.0, "until_s": 7.0},
        {
            "kind": "minor",
            "robot": "B1",
            "local_tasks": ["scan"],
            "reason": "dark",
            "at_s": 1.0,
            "until_s": None,
        },
    ],
    "takeovers": [TAKEOVER],
    "violations": ["I1 is broken"],
}


def test_a_summary() -> None:
    report = report_summary(SUMMARY, "here")
    assert (report.title, report.mission, report.result) == ("here", "explore", "blocked")
    lost, died = report.faults
    assert (lost.robot, lost.lost, lost.reason) == ("B1", ("scan",), "dark")
    assert (died.at_s, died.until_s, died.detected_us, died.taken_over_us) == (
        2.0,
        7.0,
        250_000,
        None,
    )
    assert report.deaths == [died]
    assert (report.work, report.waits, report.differences, report.utilisation) == (None,) * 4
    assert "I1 is broken" in report.notes
    assert report.to_json()["robots"][0]["utilisation"] is None


@pytest.mark.parametrize("strange", ["x", [1], 1e300, 10**400, float("nan")])
@pytest.mark.parametrize("field", ["at_s", "detected_s", "reassigned_s"])
def test_what_is_no_time_is_refused(field: str, strange: Any) -> None:
    with pytest.raises((TypeError, ValueError)):
        report_summary({**SUMMARY, "takeovers": [{**TAKEOVER, field: strange}]}, "here")


def test_names_are_text() -> None:
    tasks = {"look": {"status": 1, "robots": [2]}}
    takeover = {**TAKEOVER, "held": 3, "replacement": 4}
    report = report_summary({**SUMMARY, "global_tasks": tasks, "takeovers": [takeover]}, "here")
    assert (report.tasks[0].status, report.tasks[0].robots) == ("1", ("2",))
    assert (report.deaths[0].held, report.deaths[0].replacement) == ("3", "4")


def test_small_figures() -> None:
    assert spread([None, 3.0, 1.0, 8.0]) == {"least": 1.0, "median": 3.0, "most": 8.0}
    assert spread([None]) is None
