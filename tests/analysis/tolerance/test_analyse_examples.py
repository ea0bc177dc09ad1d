"""What is said of the examples, as worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.analysis.tolerance.analyse import Analysis, analyse
from mrbt_mesh.analysis.tolerance.readings import parallel_width, serial
from mrbt_mesh.analysis.tolerance.service import FaultyTeam
from mrbt_mesh.core.bt.tree import Kind, NodeSpec
from mrbt_mesh.core.mission.mission import MICRO, Costs, Mission, Need, SameRobotAs
from mrbt_mesh.features.bids.needs import has_bids
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.build import (
    action,
    condition,
    decorated,
    fallback,
    inverter,
    make_mission,
    parallel,
    repeat,
    sequence,
    task,
    timeout,
)
from tests.support.paths import EXAMPLES


def analysed(name: str, costs: Costs | None = None) -> Analysis:
    mission = load_mission(EXAMPLES / name / "mission.yaml")
    return analyse(mission, costs or mission.costs, limit_s=60)


def key_figures(data: dict[str, Any]) -> list[Any]:
    figures = [data["weakly_fault_tolerant"], data["strongly_fault_tolerant"]]
    for kind in ("major", "minor"):
        figures += [data[kind]["max_tolerated"], data[kind]["min_fatal"]]
    return figures


def on(capability: str, *robots: str) -> list[dict[str, str]]:
    return [{"robot": robot, "capability": capability} for robot in robots]


def test_vehicle_repair_has_the_figures_of_the_paper() -> None:
    """Kept must be C1, C2 (lifting takes both) and one B (soldering; it can do what A does).

    Majors: 6 - 3 = 3. Minors: 18 capabilities, kept are move_frame twice and one each of the
    other five: 18 - 7 = 11.
    """
    data = analysed("vehicle_repair").to_json()
    assert key_figures(data) == [False, False, 3, 1, 11, 1]
    assert data["major"]["critical"] == ["C1", "C2"]
    assert data["minor"]["critical"] == on("move_frame", "C1", "C2")
    assert (data["robots"], data["capabilities"]) == (6, 18)
    assert data["complete"]
    # There is no alternative in the tree: nothing changes if every task has to stay possible.
    assert key_figures(data["keeps_every_task"]) == key_figures(data)
    assert data["exclusive"] == {"tasks": [], "majority": 4, "max_major_faults": None}
    slack = {row["task"]: row["slack"] for row in data["tasks"]}
    assert slack["remove_cover"] == slack["place_cover"] == 0
    assert slack["remove_screws"] == slack["solder(2)"] == 1
    assert slack["diagnose_part(5)"] == slack["fix_hw(1)"] == slack["fix_wires(3)"] == 3


def test_vehicle_repair_at_its_full_width_can_spare_one_screwdriver() -> None:
    """Four parts are diagnosed at once by A1, A2, B1 and B2, then four have their hardware and
    wires replaced, then both B solder: all of those are needed, and both C lift. Only unscrewing
    is done by one where two could."""
    data = analysed("vehicle_repair").to_json()["keeps_parallel_width"]
    assert key_figures(data) == [False, False, 0, 1, 1, 1]
    assert data["major"]["critical"] == ["A1", "A2", "B1", "B2", "C1", "C2"]
    assert len(data["minor"]["critical"]) == 16
    assert not [row for row in data["minor"]["critical"] if row["capability"] == "use_screwdriver"]


def test_explore() -> None:
    """Either robot explores both areas alone; at full width both are needed."""
    data = analysed("explore").to_json()
    assert key_figures(data) == [True, True, 1, 2, 1, 2]
    assert data["major"]["critical"] == data["minor"]["critical"] == []
    width = data["keeps_parallel_width"]
    assert key_figures(width) == [False, False, 0, 1, 0, 1]
    assert width["major"]["critical"] == ["R1", "R2"]
    assert [row["slack"] for row in data["tasks"]] == [1, 1]


def test_bids_change_nothing_of_what_a_team_can_do() -> None:
    """Who has no bid serves all the same, so a need by bid is a need."""
    mission = load_mission(EXAMPLES / "couriers" / "mission.yaml")
    declared = {
        name: replace(
            each, needs=tuple(replace(need, performance_rule=None) for need in each.needs)
        )
        for name, each in mission.global_tasks.items()
    }
    assert has_bids(mission)
    found = analyse(mission, mission.costs, limit_s=60).to_json()
    other = analyse(replace(mission, global_tasks=declared), mission.costs, limit_s=60).to_json()
    assert key_figures(found) == key_figures(other)
    assert found["major"]["max_tolerated"] == 3


def test_tool_search() -> None:
    """One of two mechanics is enough. Of 6 capabilities one search and one large screwdriver are:
    the small one is for when the large one fails, which is no lack of robots. Fatal are both
    searches, or both large screwdrivers.

    With every task to stay possible a small one is kept as well. At full width both search at
    once: 2 searches and one large screwdriver are kept, 6 - 3 = 3.
    """
    data = analysed("tool_search").to_json()
    assert key_figures(data) == [True, True, 1, 2, 4, 2]
    assert key_figures(data["keeps_every_task"]) == [True, True, 1, 2, 3, 2]
    assert key_figures(data["keeps_parallel_width"]) == [False, False, 0, 1, 3, 1]
    assert data["keeps_parallel_width"]["minor"]["critical"] == on("search", "M1", "M2")
    rows = {row["task"]: row["indispensable"] for row in data["tasks"]}
    assert rows == {
        "search_storage(1)": False,
        "search_storage(2)": False,
        "tighten_with_large": True,
        "tighten_with_small": False,
    }


def test_dispense_needs_a_majority_for_its_exclusive_task() -> None:
    """3 of 5 robots must live to grant a dose, else one D and one M would do: 5 - 3 = 2. Fatal are
    both D. Kept are one fetch, dose and stir, and two lift_lid: 15 - 5 = 10. At full width both
    batches are dosed at once by both D and stirred at once by two M: one M of three may go."""
    data = analysed("dispense").to_json()
    assert key_figures(data) == [True, True, 2, 2, 10, 2]
    assert data["exclusive"] == {
        "tasks": ["dose(a)", "dose(b)"],
        "majority": 3,
        "max_major_faults": 2,
    }
    width = data["keeps_parallel_width"]
    assert (width["major"]["max_tolerated"], width["major"]["critical"]) == (1, ["D1", "D2"])


# -- advice -----------------------------------------------------------------------------------


def test_one_more_big_robot_makes_the_repair_team_strongly_tolerant() -> None:
    advice = analysed("vehicle_repair").to_json()["advice"]
    for way in ("weakly_fault_tolerant", "strongly_fault_tolerant"):
        assert advice[way]["robots_only"]["robots"] == {"C": 1}
        assert advice[way]["robots_only"]["cost"] == 1
        # Whoever else learns to lift is the third.
        (learned,) = advice[way]["capabilities_only"]["capabilities"]
        assert learned["capability"] == "move_frame"
        assert advice[way]["cheapest"]["proved"]


def test_costs_decide_what_is_cheapest() -> None:
    dear = analysed("vehicle_repair", Costs({"C": 40}, {"move_frame": 50})).to_json()["advice"]
    assert dear["weakly_fault_tolerant"]["cheapest"]["robots"] == {"C": 1}
    assert dear["weakly_fault_tolerant"]["cheapest"]["cost"] == 40
    assert dear["weakly_fault_tolerant"]["capabilities_only"]["cost"] == 50
    cheap = analysed("vehicle_repair", Costs({"C": 40}, {"move_frame": 5})).to_json()["advice"]
    assert cheap["strongly_fault_tolerant"]["cheapest"]["cost"] == 5
    nothing = analysed("explore").to_json()["advice"]["strongly_fault_tolerant"]["cheapest"]
    assert (nothing["cost"], nothing["robots"], nothing["capabilities"]) == (0, {}, [])


def test_an_exclusive_task_takes_a_third_robot_to_lose_one() -> None:
    """A second one that can do it is not enough: one of two is no majority."""
    robots = {"R1": {"g": 1}, "R2": {"h": 1}}
    mission = make_mission(action("g"), robots, [task("g", exclusive=True), task("h")])
    types = {"T": {"g": MICRO}}
    advice = analyse(replace(mission, robot_types=types), Costs(), 60).to_json()["advice"]
    strong = advice["strongly_fault_tolerant"]
    assert strong["cheapest"]["robots"] == strong["robots_only"]["robots"] == {"T": 1}
    assert strong["capabilities_only"] == {
        "cost": None,
        "bound": None,
        "proved": True,
        "robots": {},
        "capabilities": [],
    }
    (learned,) = advice["weakly_fault_tolerant"]["capabilities_only"]["capabilities"]
    assert learned == {"robot": "R2", "capability": "g"}


# -- trees ------------------------------------------------------------------------------------

A, B = action("a"), action("b")
BOTH = sequence(A, B)
WAITS = {"a": task("a"), "b": task("b")}
FAILS = {name: task(name, blocked_fail_after_us=1) for name in "ab"}


@pytest.mark.parametrize(
    ("tree", "tasks", "needed"),
    [
        (sequence(A, B), WAITS, "ab"),
        (parallel(1, A, B), WAITS, ""),
        (parallel(2, A, B), WAITS, "ab"),
        # What is blocked for ever keeps its alternative from its turn.
        (fallback(A, B), WAITS, "a"),
        (fallback(A, B), FAILS, ""),
        (decorated(Kind.FORCE_SUCCESS, A), WAITS, "a"),
        (decorated(Kind.FORCE_SUCCESS, A), FAILS, ""),
        (fallback(condition("c"), A), WAITS, "a"),
        # A condition can be made true by what comes before it: A is not for nothing.
        (sequence(fallback(condition("c"), A), condition("c"), B), WAITS, "ab"),
        (sequence(fallback(condition("c"), A), fallback(inverter(condition("c")), B)), WAITS, "ab"),
        (inverter(A), WAITS, "a"),
        (inverter(A), FAILS, ""),
        (fallback(sequence(condition("c"), A), B), FAILS, "b"),
        # A Timeout gives the alternative its turn.
        (fallback(timeout(1, A), B), WAITS, ""),
        (fallback(timeout(1, fallback(condition("c"), A)), B), WAITS, ""),
    ],
)
def test_what_a_tree_cannot_do_without(tree: NodeSpec, tasks: dict[str, Any], needed: str) -> None:
    mission = make_mission(tree, tasks=tasks.values())
    reading = serial(mission).reading
    services = [reading.services[each] for each in reading.required.indispensable]
    assert "".join(each.name for each in services if each.tasks) == needed
    assert not reading.survives(FaultyTeam(mission, frozenset(mission.robots)))


def test_either_of_two_alternatives_is_enough_but_one_must_stay() -> None:
    mission = make_mission(parallel(1, A, B), {"R1": {"a": 1}, "R2": {"b": 1}})
    data = analyse(mission, Costs(), 60).to_json()
    assert key_figures(data) == [True, True, 1, 2, 1, 2]
    assert key_figures(data["keeps_every_task"]) == [False, False, 0, 1, 0, 1]


def test_an_alternative_that_nobody_could_ever_do_is_of_no_use() -> None:
    """Told with proof, not when the time for the question is up."""
    mission = make_mission(parallel(1, A, B), {"R1": {"a": 1}})
    data = analyse(mission, Costs(), 60).to_json()
    assert data["complete"]
    assert key_figures(data) == [False, False, 0, 1, 0, 1]


def test_who_may_help_and_need_not_is_not_missed() -> None:
    robots = {"R1": {"a": 1, "b": 1}, "R2": {"a": 1, "b": 1}, "R3": {"b": 1}}
    mission = make_mission(A, robots, [task("a", ("a", 1, 1), ("b", 0, 2))])
    data = analyse(mission, Costs(), 60).to_json()
    assert key_figures(data) == [True, True, 2, 2, 4, 2]
    (only,) = data["tasks"]
    assert [need["local_task"] for need in only["needs"]] == ["a"]


def test_a_mission_that_is_not_feasible_says_why() -> None:
    lacking = make_mission(action("g"), {"R1": {"h": 1}}, [task("g"), task("h")])
    data = analyse(lacking, Costs(), 60).to_json()
    assert not data["feasible"]
    assert "cannot do g" in data["obstacle"]
    assert key_figures(data) == [False, False, None, 0, None, 0]
    hopeless = make_mission(decorated(Kind.FORCE_FAILURE, action("g")))
    assert "can never succeed" in serial(hopeless).obstacle
    # What neither succeeds nor fails never gives its alternative a turn.
    endless = make_mission(fallback(repeat(-1, decorated(Kind.FORCE_SUCCESS, A)), B))
    assert "can never succeed" in serial(endless).obstacle
    assert (
        analyse(hopeless, Costs(), 60).to_json()["advice"]["weakly_fault_tolerant"]["cheapest"][
            "cost"
        ]
        is None
    )


def test_a_mission_without_tasks_needs_a_robot_that_lives() -> None:
    """A team of nobody does nothing, not even where there is nothing to do."""
    mission = make_mission(condition("c"), {"R1": {}})
    data = analyse(mission, Costs(), 60).to_json()
    assert key_figures(data) == [True, False, 0, 1, 0, None]
    two = make_mission(condition("c"), {"R1": {}, "R2": {}})
    assert key_figures(analyse(two, Costs(), 60).to_json()) == [True, True, 1, 2, 0, None]


def bring(*robots: str, tree: NodeSpec = BOTH, **options: Any) -> Mission:
    """Robots that can do a, b or both; b is for the robot that has done a."""
    need = Need("b", 1, 1, SameRobotAs("a", "a"))
    second = replace(task("b", **options), needs=(need,))
    able = {f"R{number + 1}": dict.fromkeys(names, 1) for number, names in enumerate(robots)}
    return make_mission(tree, able, [task("a"), second])


@pytest.mark.parametrize(
    ("mission", "figures"),
    [
        # Whoever has done a may be lost before b; nobody else may do that.
        (bring("ab", "ab", "ab"), [False, False, 0, 1, 2, 1]),
        (bring("ab", "b"), [False, False, 1, 1, 1, 1]),
        # R2 may be the one that does a.
        (bring("ab", "a"), [False, False, None, 0, None, 0]),
        # Nobody need have done a.
        (bring("ab", tree=sequence(fallback(condition("c"), A), B)),
         [False, False, None, 0, None, 0]),
        # A way out.
        (bring("ab", "ab", tree=sequence(A, fallback(B, A)), blocked_fail_after_us=1),
         [True, True, 1, 2, 3, 2]),
    ],
)  # fmt: skip
def test_a_task_for_the_robot_that_did_another_one(mission: Mission, figures: list[Any]) -> None:
    data = analyse(mission, Costs(), 60).to_json()
    assert key_figures(data) == figures
    assert [each["task"] for each in data["tasks"]] == ["a", "b"]


def test_the_width_of_the_repair_is_that_of_its_six_robots() -> None:
    """In lock-step: four robots diagnose four parts, the fifth waits for its turn, and so on."""
    mission = load_mission(EXAMPLES / "vehicle_repair" / "mission.yaml")
    stages = [each.tasks for each in parallel_width(mission).reading.services]
    assert stages[0] == ("remove_screws",)
    assert stages[2] == tuple(f"diagnose_part({i})" for i in (1, 2, 3, 4))
    assert stages[3] == ("diagnose_part(5)",)
    assert ("solder(1)", "solder(2)", "fix_hw(5)") in stages
    assert max(map(len, stages)) == 4
