"""Streams of jobs keep the order of tasks, and small missions are about as short as possible."""

from __future__ import annotations

import statistics

import pytest

from benchmarks import small_missions, task_order
from mrbt_mesh.core.scheduling import order
from tests.support.effort import seeds

EVALUATIONS = 200


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(40))
def test_a_stream_of_jobs_is_done_in_the_order_of_tasks(seed: int) -> None:
    found = task_order.stream(seed, evaluations=EVALUATIONS)
    assert found.broken == [], f"seed {seed}"


# Robots stood idle, overtook what they must not, or turned to and fro for ever.
@pytest.mark.slow
@pytest.mark.parametrize("seed", [87, 93, 105, 141, 172, 188])
def test_streams_that_were_once_done_otherwise(seed: int) -> None:
    assert task_order.stream(seed).broken == [], f"seed {seed}"


@pytest.mark.slow
def test_without_the_rule_the_judge_finds_what_is_overtaken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(order, "_overdue", lambda *_: None)
    found = [task_order.stream(seed, evaluations=EVALUATIONS).broken for seed in range(4, 7)]
    assert any(found)


@pytest.mark.slow
def test_small_missions_are_about_as_short_as_the_shortest_schedule() -> None:
    ratios = [small_missions.makespan_ratio(seed) for seed in seeds(200)]
    assert statistics.mean(ratios) <= 1.01, ratios
    assert max(ratios) <= 1.10, ratios
