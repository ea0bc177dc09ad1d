"""The blackboard of a mission file: what comes of it, and what is wrong with it."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.jobs import OpenJob, with_jobs
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import FileError
from mrbt_mesh.features.values.blackboard import ValueType, comparison_of
from mrbt_mesh.formats.build import mission_from_yaml

GOOD = """\
mission: m
ends: never
parameters: {colours: [red, blue], dock: north}
local_tasks:
  look: {parameters: [shelf], sets: [found]}
  fetch: {parameters: [what]}
  weigh: {sets: [weight]}
blackboard:
  found: {values: $colours, per: job}
  weight: {min: -5, max: 99.5, decimals: 1}
  battery: {min: 0, max: 100, per: robot, default: 100}
  label: {text: 8, parameters: [shelf], default: none}
conditions: {open: {}}
robot_types: {cart: {capabilities: {look: 1, fetch: 1, weigh: 1}}}
robots: {A1: cart, A2: cart}
global_tasks:
  look: {parameters: [shelf], needs: {look($shelf): {}}}
  get: {parameters: [what], needs: {fetch($what): {}}}
  weigh: {needs: {weigh: {}}}
subtrees:
  handle: {parameters: [it], tree: get($it)}
jobs:
  sort:
    parameters: {shelf: [a, b], most: {min: 1, max: 5}}
    tree:
      Sequence:
        - look($shelf)
        - Condition: found != red
        - Condition: weight<$most
        - SubTree: handle($found)
        - Condition: label($shelf) == $shelf
tree:
  Parallel:
    - Fallback: [{Condition: battery@A1 < 30}, {Condition: battery >= 50}]
    - Sequence: [{Condition: weight >= 12.50}, get($weight)]
    - Jobs: all
"""


def read(text: str) -> Mission:
    return mission_from_yaml(text, "m.yaml", Path())


def conditions_of(mission: Mission) -> list[str]:
    return [node.subject for node in mission.tree.nodes if node.kind is Kind.CONDITION]


def test_comparisons_and_arguments_are_ground_but_for_what_is_read() -> None:
    mission = read(GOOD)
    assert conditions_of(mission) == [
        *("battery@A1 < 30", "battery >= 50", "weight >= 12.5"),
        *("found@job:{0} != red", "weight < {most}", "label({shelf}) == {shelf}"),
    ]
    assert mission.global_tasks["get($weight)"].reads == ("weight",)
    with_job = with_jobs(mission, [OpenJob("j1", "sort", ("a", "3"))])
    assert conditions_of(with_job)[3:] == ["found@job:j1 != red", "weight < 3", "label(a) == a"]
    assert "get($found)" in {node.subject for node in with_job.tree.actions()}
    assert all(map(with_job.entries.is_condition, conditions_of(with_job)))


def test_a_compiled_mission_keeps_its_blackboard() -> None:
    mission = read(GOOD)
    text = compile_mission(mission)
    again = mission_from_compiled(text, "m.json")
    assert again.conditions == mission.conditions
    assert again.digest == mission.digest


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("{text: 8,", "{text: 8, min: 1,", 12, "an entry has values, or min and max, or text"),
        ("{text: 8,", "{text: 8, decimals: 1,", 12, "decimals are those of min and max"),
        ("max: 99.5, decimals: 1", "max: 99.55, decimals: 1", 10, "at most 1 decimals"),
        ("min: -5, max: 99.5", "min: 5, max: -5", 10, "min is 5.0, but max is -5.0"),
        ("default: none", "default: no thing", 12, "a text of 1 to 8"),
        ("default: 100}", "default: 101}", 11, "a whole number from 0 to 100, not 101"),
        ("blackboard:\n", "blackboard:\n  dock: {text: 9}\n", 9, "dock is declared twice"),
        ("sets: [weight]", "sets: [height]", 7, "'height' is not a blackboard entry; did you mean"),
        ("found != red", "found != green", 28, "found: it is one of red, blue, not 'green'"),
        ("found != red", "found < red", 28, "found has no order: compare it with == or !="),
        ("found != red", "found", 28, "found is a blackboard entry; compare it, e.g. found == red"),
        ("found != red", "open == true", 28, "open is a condition, which is true or false"),
        ("found != red", "fund == red", 28, "'fund' is not a declared blackboard entry; did you"),
        ("found != red", "found = red", 28, "e.g. broken($part) or found == red"),
        ("weight<$most", "weight<$mast", 29, "unknown parameter $mast"),
        ("weight<$most", "weight<$battery", 29, "every robot has its own battery"),
        ("battery@A1", "battery@A9", 34, "there is no robot 'A9'"),
        ("battery@A1", "weight@A1", 34, "weight is not of each robot; leave out @A1"),
        ("weight >= 12.50", "weight >= 12.55", 35, "a number with 1 decimals from -5.0 to 99.5"),
        ("weight >= 12.50", "found == red", 35, "each job has its own found"),
        ("get($weight)", "get($found)", 35, "each job has its own found"),
        ("get($weight)", "get($label)", 35, "label has parameters"),
        ("get($weight)", "get($battery)", 35, "every robot has its own battery"),
        ("get($weight)", "get(x_$weight)", 35, "which is a whole argument"),
        (", sets: [found]", "", 21, "nothing sets found, so the task would wait for ever"),
        ("{fetch($what): {}}", "{fetch($weight): {}}", 18, "pass it from the tree"),
        (
            "{fetch($what): {}}",
            "{fetch($what): {performance: bid}}",
            18,
            "a bid is made before anything is read",
        ),
        ("label($shelf) == ", "open($found)\n        - Condition: label(a) == ", 31, "takes 0"),
    ],
)
def test_mistakes_are_told_with_line_and_remedy(
    old: str, new: str, line: int, message: str
) -> None:
    assert old in GOOD
    with pytest.raises(FileError) as raised:
        read(GOOD.replace(old, new))
    found = [(each.line, each.message) for each in raised.value.problems]
    assert any(at == line and message in text for at, text in found), found


# -- values -----------------------------------------------------------------------------------

TENTHS = ValueType(low=-1_000, high=1_000, decimals=1)


@pytest.mark.parametrize(
    ("kind", "given", "found"),
    [
        (TENTHS, 12.34, 123),
        (TENTHS, "-0.5", -5),
        (TENTHS, 7, 70),
        (TENTHS, 100.01, 1_000),
        (ValueType(low=0, high=9), 3.0, 3),
        (ValueType(choices=("true", "red")), True, "true"),
        (ValueType(choices=("1", "2")), 1, "1"),
        (ValueType(longest=3), "a.b", "a.b"),
    ],
)
def test_what_a_program_sets(kind: ValueType, given: object, found: object) -> None:
    assert kind.value(given, is_rounded=True) == found


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        (TENTHS, 101),
        (TENTHS, float("nan")),
        (TENTHS, float("inf")),
        (TENTHS, "much"),
        (TENTHS, None),
        (ValueType(low=0, high=9), 3.5),
        (ValueType(longest=3), "a b"),
        (ValueType(longest=3), ""),
        (ValueType(longest=3), "abcd"),
        (ValueType(choices=("red",)), "blue"),
    ],
)
def test_what_no_program_can_set(kind: ValueType, given: object) -> None:
    with pytest.raises(ValueError, match="it is"):
        kind.value(given, is_rounded=True)


@given(
    st.integers(-(10**9), 10**9),
    st.integers(-(10**9), 10**9),
    st.integers(0, 6),
    st.sampled_from(["==", "!=", "<", "<=", ">", ">="]),
)
def test_comparisons_are_those_of_exact_decimals(
    value: int, other: int, decimals: int, operator: str
) -> None:
    kind = ValueType(low=-(10**9), high=10**9, decimals=decimals)
    read = comparison_of(f"x {operator} {kind.text(other)}")
    assert read is not None
    left, right = (Decimal(kind.text(each)) for each in (value, other))
    assert kind.holds(read, value) is eval(f"left {operator} right", {"left": left, "right": right})
    assert kind.value(kind.text(value)) == value
