"""The small examples: one robot or two on the same file, and the two kinds of fallback."""

from __future__ import annotations

import itertools

import pytest

from mrbt_mesh.drills.physical import most_at_once, of, spans
from mrbt_mesh.sim import Kill
from tests.support.runs import Run


def test_two_robots_explore_in_parallel(run: Run) -> None:
    result = run("explore", 1)
    explored = spans(result.events)
    assert {s.part for s in explored} == {"A", "B"}
    assert {s.robot for s in explored} == {"R1", "R2"}
    assert most_at_once(explored) == 2
    assert result.summary["duration_s"] == pytest.approx(5, abs=0.2)


@pytest.mark.parametrize("robot", ["R1", "R2"])
def test_one_robot_explores_one_after_the_other(run: Run, robot: str) -> None:
    result = run("explore", 1, robots=[robot])
    explored = spans(result.events)
    assert [s.part for s in explored] == ["A", "B"]
    assert most_at_once(explored) == 1
    assert result.summary["duration_s"] == pytest.approx(10, abs=0.2)


def test_both_storages_are_searched_at_once_and_one_success_is_enough(run: Run) -> None:
    searches = of(spans(run("tool_search", 1).events), "search")
    assert most_at_once(searches) == 2
    assert {s.part: s.end for s in searches} == {"1": "failure", "2": "success"}


def test_the_small_screwdriver_only_if_the_large_one_does_not_fit(run: Run) -> None:
    found = spans(run("tool_search", 1).events)
    (large,), (small,) = of(found, "large_screwdriver"), of(found, "small_screwdriver")
    assert large.end == "failure"
    assert small.end == "success"
    assert large.end_s < small.start_s

    fitting = spans(run("tool_search", 1, parameters={"large_fits": True}).events)
    assert [s.end for s in of(fitting, "large_screwdriver")] == ["success"]
    assert of(fitting, "small_screwdriver") == []


def test_a_search_that_succeeds_first_ends_the_other_one(run: Run) -> None:
    """M=1: once one storage had the tools, nobody goes on looking."""
    result = run("tool_search", 1, parameters={"tools_in_storage": 1})
    searches = {s.part: s for s in of(spans(result.events), "search")}
    assert searches["1"].end == "success"
    assert searches["2"].end_s - searches["1"].end_s < 0.05


def test_no_tools_at_all_is_a_failure(run: Run) -> None:
    result = run("tool_search", 1, parameters={"tools_in_storage": 3}, expect="failure")
    assert {s.end for s in of(spans(result.events), "search")} == {"failure"}
    assert not of(spans(result.events), "large_screwdriver")


def test_couriers_bid_from_where_they_are_and_the_sum_of_ways_is_the_least(run: Run) -> None:
    result = run("couriers", 1)
    rows = {row["local_task"]: row for row in result.summary["bids"]}
    assert len(rows) == 6
    morning = [rows[f"deliver({each})"] for each in ("bread", "keys", "flowers")]
    assert morning[0]["bids"] == {"K1": -7.41, "K2": -13, "K3": -13.62, "K4": -5.12}
    best = max(
        sum(row["bids"][robot] for row, robot in zip(morning, robots, strict=True))
        for robots in itertools.permutations(["K1", "K2", "K3", "K4"], 3)
    )
    assert sum(row["bids"][row["robots"][0]] for row in morning) == pytest.approx(best)
    taken = [span.end_s - span.start_s for span in spans(result.events)]
    said = [-row["bids"][row["robots"][0]] for row in result.summary["bids"]]
    assert sorted(taken) == pytest.approx(sorted(said), abs=0.05), "they took as long as they said"


def test_each_robot_does_its_local_task_by_its_own_tree(run: Run) -> None:
    done = spans(run("assembly", 1).events)
    by_robot = {r: [s for s in done if s.robot == r] for r in ("R1", "R2")}
    told = {r: [(s.local_task, s.part, s.end) for s in found] for r, found in by_robot.items()}
    grasp, slip = ("grasp", "", "success"), ("turn", "2", "cancel")
    # What it holds it need not take up again for the next part; what has slipped it must.
    assert sorted(told.values()) == [
        [grasp, ("turn", "1", "success"), ("turn", "3", "success")],
        [grasp, slip, grasp, ("turn", "2", "success")],
    ]


def test_a_local_task_that_is_a_tree_begins_anew_with_another_robot(run: Run) -> None:
    result = run("assembly", 1, schedule=[(1_500_000, Kill("R1"))])
    done = spans(result.events)
    assert {s.part for s in done if s.end == "success" and s.local_task == "turn"} == {
        "1",
        "2",
        "3",
    }
    (cut_off,) = (s for s in done if s.end is None)
    assert (cut_off.robot, cut_off.ground) == ("R1", "turn(1)")
    # R2 holds a tool of its own, so the tree has nothing to grasp for.
    after = [s.ground for s in done if s.start_s > cut_off.start_s + 2]
    assert after == ["turn(1)", "turn(3)"]
    assert [each["replacement"] for each in result.summary["takeovers"]] == ["R2"]


def test_each_robot_inspects_by_a_tree_of_behaviortree_cpp(run: Run) -> None:
    result = run("inspection", 1)
    # Valves 2 and 4 have more than 6 bar: the trees' script says so, the team closes them.
    assert [span.ground for span in spans(result.events)] == ["close(2)", "close(4)"]
    rows = result.summary["global_tasks"]
    assert {name for name, row in rows.items() if row["status"] == "success"} == {
        *(f"inspect_valve({valve})" for valve in (1, 2, 3, 4)),
        *("close_valve(2)", "close_valve(4)"),
    }
    # Two inspections of 1.5 s each, two valves of 2 s; backing up and a second way at valve 3.
    assert result.summary["duration_s"] == pytest.approx(7.0, abs=0.2)


def test_an_inspection_begins_anew_with_another_robot(run: Run) -> None:
    result = run("inspection", 1, schedule=[(1_200_000, Kill("R1"))])
    assert [each["replacement"] for each in result.summary["takeovers"]] == ["R2"]
    assert [span.ground for span in spans(result.events)] == ["close(2)", "close(4)"]
