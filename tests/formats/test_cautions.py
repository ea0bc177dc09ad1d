"""What `mrbt validate` and `mrbt analyze` warn about, and what they accept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.failure_reasons import FailureReason
from mrbt_mesh.formats.cautions import cautions
from tests.support.build import (
    action,
    condition,
    decorated,
    fallback,
    inverter,
    make_mission,
    parallel,
    sequence,
    task,
    timeout,
)

REASON = FailureReason("global_task", "a", (), "contains", "stuck")
A, B, C = action("a"), action("b"), action("c")
X, Y = condition("x"), condition("y")
FAILS = {"blocked_fail_after_us": 5}


def of(tree: NodeSpec, *tasks: Any) -> list[str]:
    return cautions(make_mission(tree, tasks=tasks))


@pytest.mark.parametrize(
    ("tree", "named"),
    [
        (fallback(A, B), "a"),
        (fallback(A, B, C), "a or b"),
        (sequence(fallback(X, A), fallback(sequence(A, B), C)), "a or b"),
        (fallback(parallel(2, A, B), C), "a or b"),
        (fallback(parallel(1, A, B), C), "a or b"),
        (fallback(decorated(Kind.FORCE_FAILURE, A), B), "a"),
        (fallback(X, A), ""),
        (fallback(timeout(3, A), B), ""),
        (fallback(decorated(Kind.FORCE_SUCCESS, A), B), ""),
        (parallel(1, A, B), ""),
        (sequence(A, B), ""),
    ],
)
def test_a_fallback_that_waits_for_ever(tree: NodeSpec, named: str) -> None:
    found = of(tree)
    assert len(found) == bool(named)
    for line in found:
        assert f"no living robot can do {named}; add blocked: {{fail_after_s: 20}}" in line


def test_a_task_that_fails_once_it_has_been_blocked_is_no_obstacle() -> None:
    assert of(fallback(A, B), task("a", **FAILS)) == []
    (line,) = of(fallback(A, B, C), task("a", **FAILS))
    assert "no living robot can do b;" in line


def test_a_warning_names_the_node() -> None:
    (line,) = of(sequence(C, parallel(2, C, fallback(A, B))))
    assert line.startswith("Sequence/Parallel[2]/Fallback[2]: ")


def setting(**effects: bool) -> Any:
    return task("a", effects=tuple(sorted(effects.items())))


@pytest.mark.parametrize(
    ("tree", "effects", "named"),
    [
        (sequence(X, A), {"x": False}, "x to false"),
        (sequence(X, A), {"x": True}, ""),
        (sequence(X, B, A), {"x": False}, "x to false"),
        (sequence(fallback(X, B), A), {"x": False}, "x to false"),
        (sequence(inverter(X), A), {"x": True}, "x to true"),
        (sequence(X, sequence(Y, A)), {"x": False}, "x to false"),
        (sequence(X, fallback(Y, A)), {"y": True}, ""),
        (fallback(X, A), {"x": True}, ""),
        (sequence(A, X), {"x": False}, ""),
        (sequence(fallback(sequence(X, Y), B), A), {"y": False}, "y to false"),
        (sequence(fallback(sequence(X, Y), B), A), {"y": True}, ""),
        (sequence(parallel(1, X, Y), A), {"x": False, "y": False}, "x to false or y to false"),
        (sequence(parallel(1, X, Y), A), {"x": False, "y": True}, ""),
        (NodeSpec(Kind.SEQUENCE, (X, A), memory=Memory.WHILE_RUNNING), {"x": False}, ""),
    ],
)
def test_actions_that_undo_what_led_to_them(
    tree: NodeSpec, effects: dict[str, bool], named: str
) -> None:
    found = [line for line in of(tree, setting(**effects)) if "sets" in line]
    assert len(found) == bool(named)
    for line in found:
        assert f"/a sets {named}, but an earlier child of Sequence" in line
        assert "memory: while_running" in line


def test_a_large_expression_is_assumed_to_turn() -> None:
    many = [condition(f"c{number}") for number in range(12)]
    tree = sequence(parallel(1, *many), A)
    found = cautions(make_mission(tree, tasks=[setting(c3=True)]))
    assert ["sets c3 to true" in line for line in found] == [True]


def test_a_failure_condition_of_a_task_that_is_never_requested() -> None:
    declared = {"x": ConditionType("x", failure=REASON)}
    quiet = make_mission(fallback(A, sequence(X, B)), tasks=[task("a", **FAILS)])
    assert cautions(replace(quiet, conditions=declared)) == []
    never = make_mission(fallback(B, sequence(X, C)), tasks=[task("b", **FAILS)])
    (found,) = cautions(replace(never, conditions=declared))
    assert "x never holds: it is about a failure of a" in found
