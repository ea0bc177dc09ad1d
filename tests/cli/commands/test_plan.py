"""`mrbt plan`: a plan for given facts, and what is wrong with facts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from ruamel import yaml

from tests.support.command import COURIERS, EXPLORE, REPAIR, done, mrbt, refused
from tests.support.paths import ROOT


def test_plan_asks_the_solver_that_the_mission_names(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text("solver: nonsense\n" + Path(EXPLORE).read_text())
    assert "no solver 'nonsense'" in refused(mrbt("plan", str(mission)))
    done(mrbt("plan", str(mission), "--solver", "cp_sat"))


def plan(*arguments: str) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(done(mrbt("plan", *arguments, "--json")))
    return data


def write(tmp_path: Path, text: str) -> str:
    path = tmp_path / "facts.yaml"
    path.write_text(text)
    return str(path)


def test_plan_starts_with_both_c_on_the_screws() -> None:
    data = plan(REPAIR)
    assert {r: line["local_task"] for r, line in data["lines"].items()} == {
        "C1": "use_screwdriver",
        "C2": "use_screwdriver",
    }
    assert data["idle"]["A1"] == "nothing it can do is needed now"


def bounds(data: dict[str, Any]) -> list[tuple[Any, ...]]:
    keys = ("global_task", "local_task", "lower", "upper", "robots")
    return [tuple(row[key] for key in keys) for row in data["bounds"]]


def test_plan_shows_the_bounds_a_and_b_as_outcomes_shrink_them(tmp_path: Path) -> None:
    # The paper, section VI, on the first task: a = nu = 1 and b = mu = 2 for both C.
    screws = ("remove_screws", "use_screwdriver")
    assert bounds(plan(REPAIR)) == [(*screws, 1, 2, ["C1", "C2"])]
    failed = "{robot: C1, global_task: remove_screws, local_task: use_screwdriver, success: false}"
    facts = write(tmp_path, f"outcomes: [{failed}]")
    assert bounds(plan(REPAIR, "--facts", facts)) == [(*screws, 1, 1, ["C2"])]
    # What waits is asked for as well: five parts, four robots.
    facts = write(tmp_path, "done: [remove_screws, remove_cover]")
    found = bounds(plan(REPAIR, "--facts", facts))
    assert [row[2:4] for row in found] == [(1, 1)] * 5
    assert [len(row[4]) for row in found] == [1, 1, 1, 1, 0]
    output = done(mrbt("plan", REPAIR, "--facts", facts))
    assert "objective, the sum of performances: " in output
    table = output[output.index("local task") :].splitlines()
    assert table[5].split()[:5] == ["do_diagnosis(5)", "diagnose_part(5)", "1", "1", "nobody"]


def test_plan_says_what_is_blocked(tmp_path: Path) -> None:
    facts = write(tmp_path, "done: [remove_screws]\n")
    (waiting,) = plan(REPAIR, "--facts", facts, "--alive", "A1,B1,C2")["waiting"]
    assert waiting["reason"] == "blocked: move_frame needs 2, 1 alive"


def test_plan_follows_performances_that_have_changed(tmp_path: Path) -> None:
    uncovered = "conditions: {broken(2): true}\ndone: [remove_screws, remove_cover" + "".join(
        f", diagnose_part({part})" for part in range(1, 6)
    )
    best = write(tmp_path, f"{uncovered}]\n")
    assert plan(REPAIR, "--facts", best)["lines"].keys() == {"A1"}
    worse = write(tmp_path, f"{uncovered}]\nperformances: {{A1: {{replace_hw: 0.5}}}}\n")
    assert plan(REPAIR, "--facts", worse)["lines"].keys() == {"A2"}
    text = "performances: {A1: {replace_hw(2): 0}, A2: {replace_hw: 0.5}}\nlost: {B1: [replace_hw]}"
    lost = write(tmp_path, f"{uncovered}]\n{text}\n")
    lines = plan(REPAIR, "--facts", lost)["lines"]
    assert {robot: line["performance"] for robot, line in lines.items()} == {"B2": 1.0}


def test_performances_that_are_none_are_refused_with_their_line(tmp_path: Path) -> None:
    text = (
        "performances:\n  A1:\n    fly: 1\n    replace_hw: -1\n    do_diagnosis: much\n  Z9: {}\n"
    )
    said = " ".join(refused(mrbt("plan", REPAIR, "--facts", write(tmp_path, text))).split())
    assert "facts.yaml:3: performances/A1/fly: A1 has no local task 'fly'" in said
    assert "facts.yaml:4: performances/A1/replace_hw: a performance is a number from 0" in said
    assert "facts.yaml:5: performances/A1/do_diagnosis: a performance is a number" in said
    assert "facts.yaml:6: performances/Z9: no robot 'Z9'" in said


def test_plan_follows_conditions_outcomes_and_losses(tmp_path: Path) -> None:
    facts = write(
        tmp_path,
        "conditions: {broken(2): true}\n"
        "done: [remove_screws, remove_cover, diagnose_part(1), diagnose_part(2),\n"
        "       diagnose_part(3), diagnose_part(4), diagnose_part(5)]\n"
        "lost: {A1: [replace_hw]}\n",
    )
    lines = plan(REPAIR, "--facts", facts)["lines"]
    assert {r: line["local_task"] for r, line in lines.items()} == {"A2": "replace_hw(2)"}


OWN = """
mission: own
local_tasks: {pick: {}, place: {}}
conditions: {holding: {per: robot}}
robot_types: {T: {capabilities: {pick: 1, place: 1}}}
robots: {A1: T, A2: T}
global_tasks: {pick: {needs: {pick: {}}}, place: {needs: {place: {}}}}
tree: {Sequence: [{Fallback: [{Condition: holding}, pick]}, place]}
"""


@pytest.mark.parametrize("held", ["holding", "holding(cup)"])
def test_plan_asks_the_robot_for_which_a_condition_holds(tmp_path: Path, held: str) -> None:
    mission = tmp_path / "own.yaml"
    text = OWN.replace("Condition: holding", f"Condition: {held}")
    with_item = "{per: robot, parameters: [item]}"
    mission.write_text(text if held == "holding" else text.replace("{per: robot}", with_item))
    facts = write(tmp_path, f'conditions: {{"{held}@A2": true}}')
    found = plan(str(mission), "--facts", facts)
    assert {r: line["local_task"] for r, line in found["lines"].items()} == {"A2": "place"}
    assert found["pending_losses"] == []
    found = plan(str(mission), "--facts", facts, "--alive", "A1")
    assert found["waiting"][0]["reason"] == f"blocked: place needs 1 with {held}, 0 alive"
    assert found["pending_losses"] == [f"{held}@A2"]
    facts = write(tmp_path, f'conditions: {{"{held}": true}}')
    err = refused(mrbt("plan", str(mission), "--facts", str(facts)))
    assert f"every robot has its own: say whose, as in {held}@A1" in err


def test_plan_keeps_running_robots_where_they_are(tmp_path: Path) -> None:
    facts = write(tmp_path, "done: [remove_screws, remove_cover]\nrunning: {B1: diagnose_part(1)}")
    line = plan(REPAIR, "--facts", facts)["lines"]["B1"]
    assert (line["global_task"], line["pinned"]) == ("diagnose_part(1)", True)


def test_plan_with_failed_tasks_and_single_outcomes(tmp_path: Path) -> None:
    facts = write(
        tmp_path,
        "outcomes:\n  - {robot: R1, global_task: explore_area(A), local_task: explore(A),"
        " success: true}\nfailed: [explore_area(B)]\n",
    )
    assert plan(EXPLORE, "--facts", facts)["result"] == "failure"


BIDS = """bids:
  delivery(bread): {deliver(bread): {K1: -7.5, K2: -13, K3: -14, K4: -5}}
  delivery(keys): {deliver(keys): {K1: -9.5, K2: -3.5, K3: -9, K4: -2.5}}
  delivery(flowers): {deliver(flowers): {K1: -12, K2: -10, K3: -4.5, K4: null}}
"""


def test_plan_takes_bids_from_the_file_and_shows_them(tmp_path: Path) -> None:
    data = plan(COURIERS, "--facts", write(tmp_path, BIDS))
    assert {r: line["local_task"] for r, line in data["lines"].items()} == {
        "K2": "deliver(keys)",
        "K3": "deliver(flowers)",
        "K4": "deliver(bread)",
    }
    assert data["bids"][2]["bids"] == {"K1": -12, "K2": -10, "K3": -4.5, "K4": None}
    output = done(mrbt("plan", COURIERS, "--facts", write(tmp_path, BIDS)))
    assert "-4.5)" in output, "why K3 goes"
    assert "K3 -4.5, K2 -10, K1 -12, none of K4" in output


def test_plan_says_whose_bids_are_waited_for(tmp_path: Path) -> None:
    facts = write(tmp_path, BIDS.replace(", K4: null", ""))
    output = done(mrbt("plan", COURIERS, "--facts", facts, "--alive", "K1,K3,K4"))
    assert "delivery(flowers)  waiting for bids of K4" in output
    assert "K3 -4.5, K1 -12, waiting for K4" in output
    running = facts + ".running.yaml"
    Path(running).write_text(Path(facts).read_text() + "running: {K1: delivery(flowers)}\n")
    assert "goes on with what it runs (bid -12)" in mrbt("plan", COURIERS, "--facts", running)[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{delivery(x): {}}", "no global task 'delivery(x)' in this mission"),
        ("{delivery(keys): {deliver(cake): {}}}", "has no bids for 'deliver(cake)'; did you mean"),
        ("{delivery(keys): {deliver(keys): {K9: 1}}}", "no robot 'K9'"),
        ("{delivery(keys): {deliver(keys): {K1: fast}}}", "or null, expected, found the text"),
        ("{delivery(keys): {deliver(keys): {K1: true}}}", "or null, expected, found"),
        ("{delivery(keys): {deliver(keys): {K1: .nan}}}", "a finite number"),
        ("{delivery(keys): {deliver(keys): {K1: 1e7}}}", "a number from -1000000 to 1000000"),
    ],
)
def test_plan_says_what_is_wrong_with_bids(tmp_path: Path, text: str, message: str) -> None:
    assert message in refused(mrbt("plan", COURIERS, "--facts", write(tmp_path, f"bids: {text}\n")))


def test_plan_for_people_names_robots_and_reasons() -> None:
    output = done(mrbt("plan", REPAIR))
    assert "remove_screws  C1, C2" in output
    assert "nothing it can do is needed now" in output


def test_the_facts_of_the_documentation_can_be_planned_for(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "reference" / "facts-file.md").read_text()
    example = text.partition("```yaml\n")[2].partition("```")[0]
    data = plan(REPAIR, "--facts", write(tmp_path, example))
    assert data["lines"]["B1"]["pinned"]
    assert data["lines"]["B1"]["global_task"] == "diagnose_part(3)"
    for key in ("bids", *yaml.YAML().load(example)):
        assert f"`{key}`" in text, key


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("done: [remove_screw]", "1: done[1]: no global task 'remove_screw' in this mission"),
        ("conditions: {brokn(2): true}", "no condition; did you mean 'broken'?"),
        ("conditions: {broken(2): 3}", "true or false is expected, found the number 3"),
        ("running: {Z9: remove_screws}", "no robot 'Z9'"),
        ("running: {A1: remove_screws}", "A1 can do nothing that remove_screws needs"),
        ("dome: []", "unknown key 'dome'; did you mean 'done'?"),
        ("command: stop", "resume or pause or abort is expected"),
        ("outcomes: [1]", "outcomes[1]: a mapping (key: value) is expected"),
        ("lost: [A1]", "a mapping (key: value) is expected, found a list"),
        ("- a", "a mapping is expected, found a list"),
    ],
)
def test_plan_says_what_is_wrong_with_facts(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    problems = refused(mrbt("plan", REPAIR, "--facts", path))
    assert message in problems
    assert path in problems


def test_plan_refuses_unknown_robots_and_missing_files(tmp_path: Path) -> None:
    problems = refused(mrbt("plan", REPAIR, "--alive", "A1,A9"))
    assert "--alive A1,A9: mission vehicle_repair has no robot 'A9'" in problems
    problems = refused(mrbt("plan", REPAIR, "--facts", str(tmp_path / "none.yaml")))
    assert "there is no such file" in problems


SORTING = """
mission: sorting
local_tasks: {look: {sets: [found]}, fetch: {parameters: [what]}, charge: {}}
blackboard:
  found: {values: [red, blue]}
  battery: {min: 0, max: 100, decimals: 1, per: robot, default: 100}
robot_types: {cart: {capabilities: {look: 1, fetch: 1, charge: 1}}}
robots: {R1: cart, R2: cart}
global_tasks:
  look: {needs: {look: {}}}
  get: {parameters: [what], needs: {fetch($what): {}}}
  charge: {needs: {charge: {}}}
tree:
  Parallel: [{Sequence: [look, get($found)]}, {Sequence: [{Condition: battery < 30}, charge]}]
"""


def test_plan_has_the_values_of_the_blackboard(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(SORTING)
    facts = write(tmp_path, 'done: [look]\nblackboard: {found: red, "battery@R2": 12.5}\n')
    data = plan(str(mission), "--facts", facts)
    assert data["lines"]["R1"]["values"] == {"found": "red"}
    assert data["lines"]["R2"]["global_task"] == "charge", "its battery is low"
    output = done(mrbt("plan", str(mission), "--facts", facts))
    assert "with found = red" in " ".join(output.split())
    facts = write(tmp_path, 'done: [look]\nblackboard: {"battery@R2": 12.5}\n')
    waiting = plan(str(mission), "--facts", facts)
    assert waiting["waiting"][0]["reason"] == "waiting: found is not set"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("blackboard: {fund: red}", "no blackboard entry; did you mean 'found'?"),
        ("blackboard: {battery: 3}", "no blackboard entry; say whose, as in battery@A1"),
        ("blackboard: {found: pink}", "it is one of red, blue, not 'pink'"),
        ("conditions: {found: true}", "no condition"),
    ],
)
def test_plan_says_what_is_wrong_with_values(tmp_path: Path, text: str, message: str) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(SORTING)
    assert message in refused(mrbt("plan", str(mission), "--facts", write(tmp_path, text)))


DRIVING = """
mission: driving
travel: {places: {dock: [0, 0], near: [2, 0], far: [6, 0]}, speed: 2, start: dock}
local_tasks: {lift: {parameters: [place], work: 2, at: $place}}
robot_types: {cart: {capabilities: {lift: 1}}}
robots: {R1: cart, R2: cart}
global_tasks:
  one: {parameters: [place], needs: {lift($place): {min: 1, max: 1}}}
  both: {parameters: [place], needs: {lift($place): {min: 2, max: 2}}, simultaneous: true}
tree: {Sequence: [one(near), both(far), one(dock)]}
"""


def test_plan_searches_a_schedule_for_robots_that_travel(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(DRIVING)
    data = plan(str(mission))
    worker, other = ("R1", "R2") if "R1" in data["lines"] else ("R2", "R1")
    assert data["idle"] == {other: f"next in the schedule: both(far) with {worker}"}
    found = data["forecast"]
    assert found["robots"][worker]["next"].startswith(
        f"lift(near) in 1.0 s, then lift(far) with {other} in 6.0 s"
    )
    text = " ".join(done(mrbt("plan", str(mission))).split())
    assert (
        "schedule by this command (no robot searches) for makespan, 3 tasks, ends in 13.0 s" in text
    )
    assert "next in the schedule in force (performance 1)" in text, "no robot has proposed it"
    assert plan(REPAIR)["forecast"] is None
