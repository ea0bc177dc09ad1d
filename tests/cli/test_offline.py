"""validate, plan, assign, new, key: what they print and how they end."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.cli.app import app
from mrbt_mesh.core.assignment.solvers import SOLVERS
from tests.support.command import COURIERS, EXPLORE, REPAIR, mrbt
from tests.support.paths import ROOT


def assign(tmp_path: Path, problem: Any) -> tuple[int, dict[str, Any]]:
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(problem))
    code, output, problems = mrbt("assign", str(path), "--json")
    assert not problems
    return code, json.loads(output)


# -- key ----------------------------------------------------------------------------------


def test_a_key_is_made_once_and_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "team.pem"
    code, output, _ = mrbt("key", str(path))
    assert (code, output.partition(";")[0]) == (0, f"wrote {path}")
    made = path.read_bytes()
    code, _, problems = mrbt("key", str(path))
    assert code == 2
    assert "exists already" in problems
    assert path.read_bytes() == made
    code, _, problems = mrbt("key", str(tmp_path / "nowhere" / "team.pem"))
    assert code == 2
    assert "cannot write" in problems


# -- assign -------------------------------------------------------------------------------


def test_assign_solves_the_example_of_its_help(tmp_path: Path) -> None:
    problem = {
        "robots": {"r1": {"taskA": 3.0, "taskB": 4.5}, "r2": {"taskA": 3, "taskB": 4.5}, "r3": {}},
        "demands": [
            {"id": "d1", "local_task": "taskA", "min": 1, "max": 2},
            {"id": "d2", "local_task": "taskB", "min": 0, "max": 1},
        ],
    }
    code, answer = assign(tmp_path, problem)
    assert code == 0
    assert answer == {
        "feasible": True,
        "objective": 7.5,
        "assignment": {"r1": "d1", "r2": "d2", "r3": None},
    }


def test_assign_names_the_demands_that_are_short(tmp_path: Path) -> None:
    problem = {
        "robots": {"r1": {"a": 1, "b": 1}},
        "demands": [
            {"id": "first", "local_task": "a", "min": 1, "max": 1},
            {"id": "second", "local_task": "b", "min": 1, "max": 1},
            {"id": "third", "local_task": "c", "min": 1, "max": 1},
        ],
    }
    assert assign(tmp_path, problem) == (1, {"feasible": False, "short": ["second", "third"]})


def test_assign_prefers_the_order_of_the_file_among_equals(tmp_path: Path) -> None:
    """Unassigned comes last, even where it is worth as much."""
    problem = {
        "robots": {"b": {"x": 0, "y": 0}, "a": {"x": 0, "y": 0}},
        "demands": [
            {"id": "late", "local_task": "y", "min": 0, "max": 1},
            {"id": "early", "local_task": "x", "min": 0, "max": 1},
        ],
    }
    _, answer = assign(tmp_path, problem)
    assert answer["assignment"] == {"a": "late", "b": "early"}


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_assign_equals_brute_force(tmp_path_factory: pytest.TempPathFactory, data: Any) -> None:
    names = ["a", "b", "c"]
    table = st.dictionaries(st.sampled_from(names), st.integers(-1, 2))
    robots = data.draw(st.dictionaries(st.sampled_from(["r1", "r2", "r3"]), table, min_size=1))
    demands = []
    for index in range(data.draw(st.integers(0, 3))):
        low = data.draw(st.integers(0, 2))
        high = low + data.draw(st.integers(0, 1))
        task = data.draw(st.sampled_from(names))
        demands.append({"id": f"d{index}", "local_task": task, "min": low, "max": high})
    tmp_path = tmp_path_factory.mktemp("assign")
    _, answer = assign(tmp_path, {"robots": robots, "demands": demands})
    ordered = sorted(robots)
    best: tuple[float, dict[str, str | None]] | None = None
    choices = [[*(d for d in demands if d["local_task"] in robots[r]), None] for r in ordered]
    for choice in itertools.product(*choices):
        counts = [sum(c is d for c in choice) for d in demands]
        if any(not d["min"] <= n <= d["max"] for d, n in zip(demands, counts, strict=True)):
            continue
        pairs = list(zip(ordered, choice, strict=True))
        value = sum(robots[r][c["local_task"]] for r, c in pairs if c)
        if best is None or value > best[0]:
            best = value, {r: c["id"] if c else None for r, c in pairs}
    if best is None:
        assert answer["feasible"] is False
    else:
        assert (answer["objective"], answer["assignment"]) == best


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ("[]", 'expected {"robots": {...}, "demands": [...]}'),
        ('{"robots": {}, "demands": {}}', "demands: a list is expected"),
        ('{"robots": {"r": {"a": "x"}}, "demands": []}', "robots.r.a: a number is expected"),
        ('{"robots": {"r": {"a": true}}, "demands": []}', "robots.r.a: a number is expected"),
        ('{"robots": {"r": {"a": NaN}}, "demands": []}', "nan is no finite number"),
        ('{"robots": {"r": {"a": 1e300}}, "demands": []}', "out of range"),
        ('{"robots": {"r": []}, "demands": []}', "robots.r: a map of local task"),
        ('{"robots": {}, "demands": [{"id": "d"}]}', "demands[0]: id, local_task, min and max"),
        (
            '{"robots": {}, "demands": [{"id": "d", "local_task": "a", "min": 2, "max": 1}]}',
            "0 <= min <= max is expected, found min 2, max 1",
        ),
        (
            '{"robots": {}, "demands": [{"id": "d", "local_task": "a", "min": 1.5, "max": 2}]}',
            "min and max are whole numbers",
        ),
        (
            '{"robots": {}, "demands": [{"id": "d", "local_task": "a", "min": 0, "max": 1},'
            '{"id": "d", "local_task": "b", "min": 0, "max": 1}]}',
            "demand 'd' appears 2 times",
        ),
    ],
)
def test_assign_says_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "problem.json"
    path.write_text(text)
    code, output, problems = mrbt("assign", str(path), "--json")
    assert (code, output) == (2, "")
    assert message in problems
    assert str(path) in problems


SMALL = {
    "robots": {"r1": {"a": 1}, "r2": {"a": 1}},
    "demands": [{"id": "d", "local_task": "a", "min": 1, "max": 1}],
}


@pytest.mark.parametrize("solver", sorted(SOLVERS))
def test_assign_has_the_same_answer_from_every_solver(tmp_path: Path, solver: str) -> None:
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(SMALL))
    code, output, _ = mrbt("assign", str(path), "--json", "--solver", solver)
    assert code == 0
    assert json.loads(output)["assignment"] == {"r1": "d", "r2": None}


@pytest.mark.parametrize("command", ["assign", "plan", "sim", "up"])
def test_a_solver_that_cannot_be_used_is_refused(tmp_path: Path, command: str) -> None:
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(SMALL))
    file = str(path) if command == "assign" else EXPLORE
    code, output, problems = mrbt(command, file, "--solver", "cpsat")
    assert (code, output) == (2, "")
    assert "no solver 'cpsat'; did you mean 'cp_sat'?" in problems
    code, _, problems = mrbt(command, file, "--solver", "tests_have_no_such.module:solve")
    assert code == 2
    assert "put its folder on PYTHONPATH" in problems


def test_plan_asks_the_solver_that_the_mission_names(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text("solver: nonsense\n" + Path(EXPLORE).read_text())
    code, _, problems = mrbt("plan", str(mission))
    assert code == 2
    assert "no solver 'nonsense'" in problems
    code, _, _ = mrbt("plan", str(mission), "--solver", "brute_force")
    assert code == 0


# -- plan ---------------------------------------------------------------------------------


def plan(*arguments: str) -> dict[str, Any]:
    code, output, problems = mrbt("plan", *arguments, "--json")
    assert code == 0, problems
    data: dict[str, Any] = json.loads(output)
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
    assert data["idle"]["A1"] == "no request needs what it can do"


def test_plan_says_what_is_blocked(tmp_path: Path) -> None:
    facts = write(tmp_path, "done: [remove_screws]\n")
    (waiting,) = plan(REPAIR, "--facts", facts, "--alive", "A1,B1,C2")["waiting"]
    assert waiting["reason"] == "blocked: move_frame needs 2, 1 alive"


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
    code, output, _ = mrbt("plan", COURIERS, "--facts", write(tmp_path, BIDS))
    assert code == 0
    assert "-4.5)" in output, "why K3 goes"
    assert "K3 -4.5, K2 -10, K1 -12, none of K4" in output


def test_plan_says_whose_bids_are_waited_for(tmp_path: Path) -> None:
    facts = write(tmp_path, BIDS.replace(", K4: null", ""))
    code, output, _ = mrbt("plan", COURIERS, "--facts", facts, "--alive", "K1,K3,K4")
    assert code == 0
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
    code, _, problems = mrbt("plan", COURIERS, "--facts", write(tmp_path, f"bids: {text}\n"))
    assert code == 2
    assert message in problems


def test_plan_for_people_names_robots_and_reasons() -> None:
    code, output, _ = mrbt("plan", REPAIR)
    assert code == 0
    assert "remove_screws  C1, C2" in output
    assert "no request needs what it can do" in output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("done: [remove_screw]", "1: done[1]: no global task 'remove_screw' in this mission"),
        ("conditions: {brokn(2): true}", "no condition; did you mean 'broken'?"),
        ("conditions: {broken(2): 3}", "true or false expected, found the number 3"),
        ("running: {Z9: remove_screws}", "no robot 'Z9'"),
        ("running: {A1: remove_screws}", "A1 can do nothing that remove_screws needs"),
        ("dome: []", "unknown key; did you mean 'done'?"),
        ("order: stop", "one of resume, pause, abort expected"),
        ("outcomes: [1]", "a mapping with global_task, local_task, robot, success expected"),
        ("lost: [A1]", "a mapping expected, found a list"),
        ("- a", "a mapping is expected, found a list"),
    ],
)
def test_plan_says_what_is_wrong_with_facts(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    code, _, problems = mrbt("plan", REPAIR, "--facts", path)
    assert code == 2
    assert message in problems
    assert path in problems


def test_plan_refuses_unknown_robots_and_missing_files(tmp_path: Path) -> None:
    code, _, problems = mrbt("plan", REPAIR, "--alive", "A1,A9")
    assert code == 2
    assert "the mission has no robot 'A9'" in problems
    code, _, problems = mrbt("plan", REPAIR, "--facts", str(tmp_path / "none.yaml"))
    assert code == 2
    assert "there is no such file" in problems


# -- validate, new ------------------------------------------------------------------------


def test_validate_says_what_a_mission_holds() -> None:
    code, output, _ = mrbt("validate", REPAIR)
    assert code == 0
    assert "valid vehicle_repair: 6 robots, 6 local tasks, 24 global tasks" in output


def test_validate_names_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "mission.yaml"
    path.write_text(Path(EXPLORE).read_text().replace("max: 1", "max: 0"))
    code, output, problems = mrbt("validate", str(path))
    assert (code, output) == (2, "")
    line = next(i for i, text in enumerate(path.read_text().splitlines(), 1) if "max: 0" in text)
    assert f"{path}:{line}:" in problems.replace("\n", "")


def test_a_compiled_mission_is_the_same_mission(tmp_path: Path) -> None:
    compiled = tmp_path / "mission.json"
    assert mrbt("validate", REPAIR, "--compile", str(compiled))[0] == 0
    digests = [
        json.loads(mrbt("validate", p, "--json")[1])["digest"] for p in (REPAIR, str(compiled))
    ]
    assert digests[0] == digests[1]


def test_new_writes_a_valid_mission_and_spares_what_is_there(tmp_path: Path) -> None:
    folder = tmp_path / "my_team"
    code, output, _ = mrbt("new", str(folder))
    assert code == 0
    assert "mrbt up" in output
    assert mrbt("validate", str(folder / "mission.yaml"))[0] == 0
    code, _, problems = mrbt("new", str(folder))
    assert code == 2
    assert str(folder) in problems.replace("\n", "")


# -- the rest -----------------------------------------------------------------------------


def test_every_command_has_help_with_an_example() -> None:
    names = [command.name or command.callback.__name__ for command in app.registered_commands]
    assert {"up", "agent", "kill", "freeze", "thaw", "fault", "restore", "join"} < set(names)
    assert {"leave", "status", "validate", "plan", "assign", "sim", "new"} < set(names)
    for name in names:
        code, output, _ = mrbt(name, "--help")
        assert code == 0
        assert "Example" in output, name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("up", REPAIR, "--robots", "A1,Z9"), "mission vehicle_repair has no robot Z9"),
        (("up", REPAIR, "--robots", "A1,A1"), "a robot is named twice"),
        (("up", REPAIR, "--beat", "1"), "the detection time must be at least 3 beat periods"),
        (("up", "nowhere.yaml"), "nowhere.yaml"),
        (("up", REPAIR, "--program", "nowhere.py"), "nowhere.py: there is no such file"),
        (("kill", "A1"), "no run is known here: start one with `mrbt up`"),
        (("status",), "no run is known here"),
    ],
)
def test_bad_input_is_a_message_and_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    code, _, problems = mrbt(*arguments)
    assert code == 2
    assert message in problems.replace("\n", " ")


def test_the_readme_shows_the_example_as_it_is() -> None:
    example = Path(EXPLORE).read_text()
    assert example[example.index("mission: explore") :] in (ROOT / "README.md").read_text()
