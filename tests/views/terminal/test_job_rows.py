"""Jobs as rows and in full."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.core.mission.mission import JobParameter, JobType
from mrbt_mesh.views.terminal.job_rows import (
    counts_text,
    in_order,
    job_details,
    job_text,
    nothing_text,
)

NOW_US = 1_700_000_000_000_000
MINUTE_US = 60_000_000


def job(state: str, **changed: Any) -> dict[str, Any]:
    """The item of a job, with these values in place of the usual ones."""
    usual: dict[str, Any] = {"type": "deliver", "arguments": {"shelf": "shelf_2", "boxes": 3}}
    usual |= {"not_before_us": 0, "deadline_us": 0, "why": "", "priority": 0}
    usual |= {"robots": (), "operator": "ann", "since_s": 1.0}
    return usual | {"state": state} | changed


def test_a_row_has_state_id_type_robots_priority_and_deadline() -> None:
    item = job("running", robots=("C1",), priority=5, deadline_us=NOW_US + 3 * MINUTE_US)
    row = "▶ running   j1 deliver(shelf_2,3) C1 priority 5 due in 3 min"
    assert job_text("j1", item, NOW_US).plain == row


def test_a_row_says_what_a_job_waits_for() -> None:
    item = job("waiting", why="behind others")
    assert job_text("j1", item, NOW_US).plain.endswith("deliver(shelf_2,3) behind others")
    later = job("waiting", why="not before ..", not_before_us=NOW_US + 10 * MINUTE_US)
    assert job_text("j1", later, NOW_US).plain.endswith("deliver(shelf_2,3) begins in 10 min")


@pytest.mark.parametrize(
    ("state", "left_us", "unix_us", "said"),
    [
        ("waiting", 90_000_000, NOW_US, " due in 90 s"),
        ("waiting", -5_000_000, NOW_US, " due 5 s ago"),
        ("waiting", 90_000_000, None, ""),
        ("succeeded", 90_000_000, NOW_US, ""),
    ],
)
def test_a_deadline_is_told_while_a_job_is_open(
    state: str, left_us: int, unix_us: int | None, said: str
) -> None:
    item = job(state, deadline_us=NOW_US + left_us)
    assert job_text("j1", item, unix_us).plain == f"{_sign(state)} j1 deliver(shelf_2,3){said}"


def _sign(state: str) -> str:
    return {"waiting": "◷ waiting  ", "succeeded": "✔ succeeded"}[state]


def test_those_at_work_come_first_and_the_newest_that_have_ended() -> None:
    jobs = {
        "old": job("succeeded", since_s=3.0),
        "new": job("failed", since_s=9.0),
        "low": job("waiting"),
        "high": job("held", priority=2),
        "busy": job("running"),
    }
    assert in_order(jobs) == ["busy", "high", "low", "new", "old"]
    assert counts_text(jobs.values()) == "1 running, 1 waiting, 1 held, 2 ended"


def test_all_that_is_known_of_a_job() -> None:
    item = job("held", priority=2, why="held by ann", deadline_us=NOW_US + 3 * MINUTE_US)
    assert job_details("j1", item, NOW_US).plain.splitlines() == [
        "‖ held deliver(shelf_2,3)  j1",
        "held by ann",
        "priority 2, deadline 2023-11-14 22:16:20 UTC (due in 3 min), submitted by ann",
    ]
    done = job("succeeded", robots=("C1", "C2"), priority=None)
    assert "C1, C2 worked on it" in job_details("j1", done, NOW_US).plain


def test_without_jobs_it_is_said_how_to_submit_one() -> None:
    kind = JobType("deliver", (JobParameter("shelf"), JobParameter("boxes")))
    assert nothing_text({"deliver": kind}) == "none yet: mrbt submit deliver shelf boxes"
