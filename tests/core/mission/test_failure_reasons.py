"""Reasons of failures as they are kept, and which conditions follow from them."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.failure_reasons import (
    CONTAINS,
    EQUALS,
    GLOBAL,
    LOCAL,
    MAX_REASON,
    FailureReason,
    one_line,
)
from mrbt_mesh.core.mission.mission import mission_from_json
from mrbt_mesh.errors import FileError
from tests.support.build import action, condition, fallback, make_mission

NAMES = ("p", "q")
VALUES = ("1", "2")


@given(st.text(max_size=3 * MAX_REASON))
def test_a_reason_is_one_printable_line_of_bounded_length(text: str) -> None:
    line = one_line(text)
    assert len(line) <= MAX_REASON
    assert line.isprintable()
    assert line == line.strip()
    assert one_line(line) == line
    if text.isascii() and text.isprintable() and len(text) <= MAX_REASON:
        assert line.split() == text.split()


def test_what_is_cut_says_so() -> None:
    assert one_line("x" * (MAX_REASON + 1)) == "x" * (MAX_REASON - 1) + "…"
    assert one_line("a\n\tb\x00c") == "a b?c"


@pytest.mark.parametrize(
    ("match", "reason", "fits"),
    [
        (CONTAINS, "no path to dock", True),
        (CONTAINS, "No path", False),
        (CONTAINS, "", False),
        (EQUALS, "no path", True),
        (EQUALS, "no path to dock", False),
    ],
)
def test_which_reasons_fit(match: str, reason: str, fits: bool) -> None:
    assert FailureReason(GLOBAL, "drive", (), match, "no path").fits(reason) is fits


@given(
    st.lists(st.sampled_from(("$p", "$q", *VALUES)), min_size=2, max_size=3),
    st.sampled_from((GLOBAL, LOCAL)),
)
def test_arguments_are_bound_as_substitution_says(pattern: list[str], kind: str) -> None:
    """Against brute force: of all values, those that make the pattern the ground task."""
    parameters = tuple(name for name in NAMES if f"${name}" in pattern)
    told = FailureReason(kind, "drive", tuple(pattern), CONTAINS, "x")
    for ground in product(VALUES, repeat=len(pattern)):
        fitting = [
            values
            for values in product(VALUES, repeat=len(parameters))
            if tuple(
                dict(zip(parameters, values, strict=True)).get(each.lstrip("$"), each)
                for each in pattern
            )
            == ground
        ]
        call = f"drive({','.join(ground)})"
        tasks = (call, "other") if kind == GLOBAL else ("other", call)
        assert told.bind(parameters, *tasks) == (fitting[0] if fitting else None)
        assert told.bind(parameters, *reversed(tasks)) is None


@pytest.mark.parametrize(
    ("outcome", "expected"),
    [
        (("go", "drive(a)", False, "no path"), ("blocked(a)", True)),
        (("go", "drive(a)", False, "tired"), ("blocked(a)", False)),
        (("go", "drive(a)", True, ""), ("blocked(a)", False)),
        (("go", "drive", False, "no path"), None),
        (("drive(a)", "go", False, "no path"), None),
    ],
)
def test_the_condition_that_an_outcome_sets(
    outcome: tuple[str, str, bool, str], expected: tuple[str, bool] | None
) -> None:
    reason = FailureReason(LOCAL, "drive", ("$place",), CONTAINS, "path")
    assert ConditionType("blocked", ("place",), failure=reason).after_end(*outcome) == expected
    assert ConditionType("blocked").after_end(*outcome) is None


def test_they_are_kept_when_compiled_and_missions_without_keep_their_digest() -> None:
    tree = fallback(action("drive"), condition("c1"))
    plain = make_mission(tree)
    told = ConditionType("c1", failure=FailureReason(GLOBAL, "drive", (), EQUALS, "stuck"))
    mission = replace(plain, conditions={"c1": told})
    again = mission_from_json(mission.to_json())
    assert again.conditions["c1"] == told
    assert again.digest == mission.digest != plain.digest
    assert mission.conditions_after_end("drive", "drive", False, "stuck") == [("c1", True)]
    assert "stuck" not in str(plain.to_json())


@pytest.mark.parametrize(
    "damage",
    [
        {"kind": "team"},
        {"match": "is"},
        {"arguments": [1]},
        {"arguments": ["$place"]},
        {"text": None},
        {"why": "stuck"},
    ],
)
def test_damaged_ones_are_refused(damage: dict[str, object]) -> None:
    told = ConditionType("c1", failure=FailureReason(GLOBAL, "drive", (), EQUALS, "stuck"))
    mission = make_mission(fallback(action("drive"), condition("c1")))
    data = json.loads(compile_mission(replace(mission, conditions={"c1": told})))
    mission_from_compiled(json.dumps(data), "m.json")
    data["conditions"]["c1"]["failure"] |= damage
    with pytest.raises(FileError, match="compile the mission again"):
        mission_from_compiled(json.dumps(data), "m.json")
