"""Examples of trees, robots and capabilities alone, which need no feature."""

from __future__ import annotations

import pytest

from mrbt_mesh.sim import Kill
from tests.support.runs import Run


def test_two_robots_explore_until_one_dies(run: Run) -> None:
    both = run("explore", 1).events
    assert {each["robot"] for each in both if each["event"] == "end"} == {"R1", "R2"}
    assert max(each["t"] for each in both) == pytest.approx(5, abs=0.2)
    alone = run("explore", 1, schedule=[(1_000_000, Kill("R2"))])
    ends = [(each["robot"], each["outcome"]) for each in alone.events if each["event"] == "end"]
    assert ends == [("R1", "success"), ("R1", "success")]
    assert [each["replacement"] for each in alone.summary["takeovers"]] == ["R1"]


def test_a_search_fails_over_to_the_other_screwdriver(run: Run) -> None:
    ends = [each for each in run("tool_search", 1).events if each["event"] == "end"]
    last = [(each["local_task"], each["outcome"]) for each in ends[-2:]]
    assert last == [("large_screwdriver", "failure"), ("small_screwdriver", "success")]
    run("tool_search", 1, parameters={"tools_in_storage": 3}, expect="failure")


def test_the_same_seed_gives_the_same_run(run: Run) -> None:
    first, again = (run("explore", 7, schedule=[(1_000_000, Kill("R1"))]) for _ in range(2))
    assert first.events == again.events
    assert first.events
