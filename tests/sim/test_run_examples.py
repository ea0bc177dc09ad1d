"""The small examples: one robot or two on the same file, and the two kinds of fallback."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from mrbt_mesh.drills.physical import spans
from mrbt_mesh.sim import Kill
from mrbt_mesh.testing import RunMission
from tests.support.paths import ROOT, mission_file
from tests.support.runs import Run


def test_two_robots_explore_in_parallel(run_mission: RunMission) -> None:
    run = run_mission(mission_file("explore"), seed=1)
    assert {event.local_task for event in run.ends} == {"explore(A)", "explore(B)"}
    assert set(run.succeeded("explore")) == {"R1", "R2"}
    assert max(event.at_s for event in run.starts) < min(event.at_s for event in run.ends)
    assert run.duration_s == pytest.approx(5, abs=0.2)


@pytest.mark.parametrize("robot", ["R1", "R2"])
def test_one_robot_explores_one_after_the_other(run_mission: RunMission, robot: str) -> None:
    run = run_mission(mission_file("explore"), seed=1, robots=[robot])
    assert [event.local_task for event in run.starts] == ["explore(A)", "explore(B)"]
    assert run.ends[0].at_s <= run.starts[1].at_s
    assert run.duration_s == pytest.approx(10, abs=0.2)


def test_both_storages_are_searched_at_once_and_one_success_is_enough(
    run_mission: RunMission,
) -> None:
    run = run_mission(mission_file("tool_search"), seed=1)
    assert len(set(run.started("search"))) == 2
    assert (len(run.failed("search(1)")), len(run.succeeded("search(2)"))) == (1, 1)
    assert run.failures[0].reason == "no tools in storage 1"


def test_the_small_screwdriver_only_if_the_large_one_does_not_fit(run_mission: RunMission) -> None:
    run = run_mission(mission_file("tool_search"), seed=1)
    last = [(event.local_task, event.outcome) for event in run.ends[-2:]]
    assert last == [("large_screwdriver", "failure"), ("small_screwdriver", "success")]
    assert run.starts[-1].at_s > run.ends[-2].at_s

    fitting = run_mission(mission_file("tool_search"), seed=1, parameters={"large_fits": True})
    assert len(fitting.succeeded("large_screwdriver")) == 1
    assert fitting.started("small_screwdriver") == []
    assert fitting.status("tighten_with_small") == "idle"


def test_a_search_that_succeeds_first_ends_the_other_one(run_mission: RunMission) -> None:
    """M=1: once one storage had the tools, nobody goes on looking."""
    run = run_mission(mission_file("tool_search"), seed=1, parameters={"tools_in_storage": 1})
    ends = {event.local_task: event for event in run.ends}
    assert ends["search(1)"].outcome == "success"
    assert ends["search(2)"].at_s - ends["search(1)"].at_s < 0.05


def test_no_tools_at_all_is_a_failure(run_mission: RunMission) -> None:
    run = run_mission(mission_file("tool_search"), seed=1, parameters={"tools_in_storage": 3})
    assert run.result == "failure"
    assert len(run.failed("search")) == 2
    assert run.started("large_screwdriver") == []


@pytest.mark.slow
def test_the_depot_is_ready_sooner_by_schedules(run_mission: RunMission, tmp_path: Path) -> None:
    text = mission_file("depot").read_text().replace("../../agents", str(ROOT / "agents"))
    without = tmp_path / "mission.yaml"
    without.write_text(text.replace("travel:", "travel:\n  horizon: 1"))
    looking_ahead, one_by_one = (
        run_mission(path, seed=1) for path in (mission_file("depot"), without)
    )
    assert looking_ahead.duration_s < 0.7 * one_by_one.duration_s


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


def test_each_robot_assembles_by_its_own_tree(run: Run) -> None:
    done = spans(run("assembly", 1).events)
    took = {s.ground: pytest.approx(s.end_s - s.start_s, abs=0.2) for s in done if s.end}
    # To grasp takes a second, to turn two. What it holds it need not take up again for the next
    # part; what has slipped it must.
    assert took == {"fasten(1)": 3, "fasten(2)": 4, "fasten(3)": 2}
    robots = {s.ground: s.robot for s in done}
    assert robots["fasten(1)"] == robots["fasten(3)"] != robots["fasten(2)"]


def test_an_assembly_begins_anew_with_another_robot(run: Run) -> None:
    result = run("assembly", 1, schedule=[(1_500_000, Kill("R1"))])
    done = spans(result.events)
    assert {s.part for s in done if s.end == "success"} == {"1", "2", "3"}
    (cut_off,) = (s for s in done if s.end is None)
    assert (cut_off.robot, cut_off.ground) == ("R1", "fasten(1)")
    # R2 holds a tool of its own, so the tree has nothing to grasp for.
    after = [s for s in done if s.start_s > cut_off.start_s + 2]
    assert [s.ground for s in after] == ["fasten(1)", "fasten(3)"]
    assert [s.end_s - s.start_s for s in after] == pytest.approx([2, 2], abs=0.1)
    assert [each["replacement"] for each in result.summary["takeovers"]] == ["R2"]


def test_each_robot_inspects_by_a_tree_of_behaviortree_cpp(run: Run) -> None:
    result = run("inspection", 1)
    # Valves 2 and 4 have more than 6 bar: the trees' script says so, the team closes them.
    done = spans(result.events)
    assert [s.ground for s in done if s.local_task == "close"] == ["close(2)", "close(4)"]
    assert sorted(s.part for s in done if s.local_task == "inspect") == ["1", "2", "3", "4"]
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
    done = spans(result.events)
    assert [s.ground for s in done if s.local_task == "close"] == ["close(2)", "close(4)"]
    (cut_off,) = (span for span in done if span.end is None)
    assert (cut_off.robot, cut_off.ground) == ("R1", "inspect(1)")
