"""Few and many open jobs: what is in the tree, and what is left of them."""

from __future__ import annotations

from benchmarks.open_jobs import Desk, run


def test_facts_shrink_when_jobs_end() -> None:
    found = run(few=10, many=1_500, robots=10)
    assert found["many"]["facts"][0] > 1_500
    assert found["shrinks"]


def test_the_tree_is_no_larger_with_more_open_jobs() -> None:
    few, many = (Desk(10, count).plan().evaluation.tree for count in (20, 500))
    assert len(few.nodes) == len(many.nodes)
