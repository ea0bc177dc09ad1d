"""The account of a stream of jobs: a short stream, and what the account must not let pass."""

from __future__ import annotations

from typing import Any
from unittest import mock

import pytest

from benchmarks.job_stream import Submitted, account, run
from mrbt_mesh.core.facts.jobs import KnownJob
from tests.support.effort import seeds


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(10))
def test_every_job_of_a_stream_is_done_expired_or_cancelled(seed: int) -> None:
    found = run(30, 120, seed)
    assert (found["broken"], found["open_at_the_end"]) == ([], 0), f"seed {seed}"
    assert found["died_at_work"], "no robot died at work"


@pytest.mark.slow
def test_jobs_that_go_on_after_their_end_are_found() -> None:
    """A team that does not heed cancellations does what nobody wants any more."""
    with mock.patch.object(KnownJob, "is_cancelled", property(lambda _: False)):
        assert run(30, 120, 1)["broken"]


def event(task: str, at_s: float, outcome: str | None = "success") -> Any:
    what = "start" if outcome is None else "end"
    return {"activation": "r:1@a:x::0", "local_task": task, "t": at_s} | {
        "event": what,
        "outcome": outcome,
    }


@pytest.mark.parametrize(
    ("events", "cancelled_s", "state", "broken"),
    [
        ([event("take", 5), event("put", 9)], None, "done", []),
        ([event("take", 5), event("take", 6, "failure")], None, "expired", []),
        ([event("take", 5)], 7, "cancelled", []),
        ([event("take", 5), event("put", 9)], 7, "done", ["a: put end 9, late"]),
        ([event("take", 12, None)], None, "expired", ["a: take start 12, late"]),
        ([event("take", 5), event("take", 6)], None, "expired", ["a was done twice: {'take': 2}"]),
    ],
)
def test_what_is_done_late_or_twice_is_found(
    events: list[Any], cancelled_s: float | None, state: str, broken: list[str]
) -> None:
    counts, found = account([Submitted("a", "deliver", 10, cancelled_s)], events)
    assert (dict(counts), found) == ({state: 1}, broken)
