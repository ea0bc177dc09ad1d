"""Metrics as plain data."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.metrics.families import DURATIONS_S, Distribution, by_name, gauge


def test_a_duration_counts_up_to_its_bound_included() -> None:
    found = Distribution((0.1, 1.0))
    for seconds in (0.0, 0.1, 0.1001, 1.0, 7.0):
        found.observe(seconds)
    assert found.buckets() == [("0.1", 2.0), ("1.0", 4.0), ("+Inf", 5.0)]
    assert round(found.sum_s, 4) == 8.2001


@given(st.lists(st.floats(0, 100)))
def test_buckets_never_fall_and_end_with_all(durations: list[float]) -> None:
    found = Distribution()
    for seconds in durations:
        found.observe(seconds)
    counts = [count for _, count in found.buckets()]
    assert all(before <= after for before, after in itertools.pairwise(counts))
    assert counts[-1] == len(durations)
    for bound, count in zip(DURATIONS_S, counts, strict=False):
        assert count == sum(seconds <= bound for seconds in durations)


def test_one_of_several_holds() -> None:
    family = gauge("m", "Which.", by_name({"running": 1.0}, ("running", "idle")), "status")
    assert family.samples == ((("idle",), 0.0), (("running",), 1.0))
