"""A short week of jobs: nothing grows once the history of ended jobs is full."""

from __future__ import annotations

from unittest import mock

import pytest

from benchmarks.job_week import run
from mrbt_mesh.core.facts import jobs


@pytest.mark.slow
def test_nothing_grows_with_the_jobs_that_were_done() -> None:
    limits = {"KEPT_ENDS": 10, "MAX_ARCHIVED": 10, "KEPT_ARCHIVES": 2}
    with mock.patch.multiple(jobs, **limits):
        found = run(400, 1_200)
    tenths = [{k: v for k, v in tenth.items() if k != "plan_us"} for tenth in found["tenths"]]
    assert found["open_at_the_end"] == 0
    assert not {*found["grown"]} - {"plan_us"}, tenths
    assert all(tenth["facts"] < 60 and tenth["archived"] <= 20 for tenth in tenths), tenths


def test_what_is_kept_of_jobs_shows() -> None:
    """Without an end of the history the facts grow with the jobs."""
    with mock.patch.multiple(jobs, KEPT_ENDS=10_000):
        assert "facts" in run(100, 300)["grown"]
