"""`mrbt assign`: the canonical optimum of one problem, or which demands are short."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.core.assignment.solvers import SOLVERS
from tests.support.command import mrbt


def assign(tmp_path: Path, problem: Any) -> tuple[int, dict[str, Any]]:
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(problem))
    code, output, problems = mrbt("assign", str(path), "--json")
    assert not problems
    return code, json.loads(output)


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


@settings(max_examples=60)
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
