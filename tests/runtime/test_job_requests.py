"""What becomes of requests about jobs before any robot is asked."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from mrbt_mesh.core.facts.jobs import hash_of
from mrbt_mesh.core.mission.mission import JobType
from mrbt_mesh.runtime.job_requests import (
    MAX_UNIX_US,
    JobRefusedError,
    arguments_of,
    check_job,
    job_change,
    job_value,
    needs_now,
)
from tests.support.one_robot import MISSION

S = 1_000_000
NOW_US = 1_000_000_000 * S
PLAIN, URGENT = JobType("look"), JobType("look", priority=7, deadline_us=60 * S)


@pytest.mark.parametrize(
    ("kind", "given", "value"),
    [
        (PLAIN, {}, [0, 0, 0]),
        (PLAIN, {"priority": -2}, [-2, 0, 0]),
        (URGENT, {}, [7, 0, NOW_US + 60 * S]),
        (URGENT, {"not_before": timedelta(seconds=5)}, [7, NOW_US + 5 * S, NOW_US + 65 * S]),
        (URGENT, {"not_before": timedelta(seconds=-5)}, [7, NOW_US - 5 * S, NOW_US + 60 * S]),
        (URGENT, {"deadline": timedelta(seconds=9)}, [7, 0, NOW_US + 9 * S]),
        (PLAIN, {"deadline": datetime.fromtimestamp(1_000_000_060, UTC)}, [0, 0, NOW_US + 60 * S]),
    ],
)
def test_times_and_priority_of_a_job(
    kind: JobType, given: dict[str, Any], value: list[int]
) -> None:
    asked = {"priority": None, "not_before": None, "deadline": None} | given
    found = job_value(kind, ["a"], **asked, now_us=NOW_US)
    assert found[:-1] == ["look", ["a"], *value]
    later = job_value(kind, ["a"], **asked, now_us=NOW_US + S)
    assert found[-1] == later[-1], "the same request is known by it"
    times = asked["not_before"], asked["deadline"]
    assert needs_now(kind, *times) is (found != later)


def test_the_same_request_has_one_hash_in_all_versions() -> None:
    """It is in journals."""
    found = job_value(URGENT, ["a", "b"], None, timedelta(seconds=1), None, NOW_US)
    assert found[-1] == hash_of('[["look", "a", "b"], 7, "+1000000", null]')


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ((timedelta(days=-20_000), None), "not_before: before 1970"),
        ((None, timedelta(microseconds=MAX_UNIX_US)), "deadline: at most a year from now"),
    ],
)
def test_times_that_no_fact_can_hold(times: tuple[Any, Any], message: str) -> None:
    with pytest.raises(JobRefusedError, match=message):
        job_value(PLAIN, [], None, *times, NOW_US)


def test_what_any_robot_would_refuse() -> None:
    for kind, arguments, name, priority, message in (
        ("delivr", (), "a", None, "no job type 'delivr'; did you mean 'deliver'"),
        ("inspect", ("a b",), "a", None, "where"),
        ("inspect", ("shelf_1",), "..", None, "'..' is not an id: 1 to 64 letters"),
        ("inspect", ("shelf_1",), "a", 1_001, "a priority is a whole number from -1000 to 1000"),
    ):
        with pytest.raises(JobRefusedError, match=message):
            check_job(MISSION, kind, arguments, name, priority)
    with pytest.raises(JobRefusedError, match="deliver takes the arguments"):
        arguments_of(MISSION, "deliver", {"boxes": 1})
    assert check_job(MISSION, "inspect", ["shelf_1"], "a", 3) is MISSION.jobs["inspect"]


def test_changes_of_a_job() -> None:
    assert job_change("a", "hold_now") == ("job_hold", "now")
    assert job_change("a", "priority", 4) == ("job_priority", 4)
    for given, message in (
        (("a b", "hold"), "no job 'a b' is known"),
        (("a", "stop"), "no change 'stop'; there is cancel, hold"),
        (("a", "priority", True), "a priority is a whole number"),
    ):
        with pytest.raises(JobRefusedError, match=message):
            job_change(*given)
