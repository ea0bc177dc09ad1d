"""`failure_reason` in mission files: what it becomes, and what is said of mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.core.mission.failure_reasons import FailureReason
from mrbt_mesh.errors import FileError
from mrbt_mesh.formats.build import mission_from_yaml

# The condition stands on line 6.
MISSION = """\
mission: m
parameters: {home: base, gap: "a b"}
local_tasks: {drive: {parameters: [place, speed]}, clear: {}}
conditions:
  open: {default: true}
  blocked: {parameters: [place], failure_reason: {local_task: "drive($place,slow)", contains: bar}}
robot_types: {T: {capabilities: {drive: 1, clear: 1}}}
robots: {R1: T}
global_tasks:
  go: {parameters: [place], needs: {"drive($place, slow)": {}}}
  clear: {needs: {clear: {}}}
tree: {Fallback: [go(dock), {Sequence: [{Condition: blocked(dock)}, clear]}]}
"""
GIVEN = """failure_reason: {local_task: "drive($place,slow)", contains: bar}"""


def conditions(text: str) -> dict[str, FailureReason | None]:
    mission = mission_from_yaml(text, "m.yaml", Path("/nowhere"))
    return {name: each.failure for name, each in mission.conditions.items()}


def test_a_condition_of_a_local_task() -> None:
    told = FailureReason("local_task", "drive", ("$place", "slow"), "contains", "bar")
    assert conditions(MISSION) == {"blocked": told, "open": None}


def test_a_condition_of_a_global_task_with_a_parameter_of_the_mission() -> None:
    text = MISSION.replace(GIVEN, "failure_reason: {global_task: go($home), equals: stuck}")
    text = text.replace("parameters: [place], failure_reason", "failure_reason")
    text = text.replace("blocked(dock)", "blocked")
    told = FailureReason("global_task", "go", ("base",), "equals", "stuck")
    assert conditions(text)["blocked"] == told


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("{local_task: drive($place), contains: x}", "local task 'drive' takes 2 arguments"),
        ("{global_task: goo($place), contains: x}", "'goo' is not a declared global task; did you"),
        ("{global_task: go(dock), contains: x}", "$place is not an argument of go(dock)"),
        ("{global_task: go($plac), contains: x}", "unknown parameter $plac"),
        ("{global_task: go(x$place), contains: x}", "$place is not an argument of go(x$place)"),
        ("{local_task: 'drive($place,x$place)', contains: x}", "must be a whole argument here"),
        ("{local_task: 'drive($place,$gap)', contains: x}", "an argument has 1 to 64 letters"),
        ("{global_task: go($place)}", "failure_reason takes either equals or contains"),
        ("{global_task: go($place), equals: x, contains: x}", "either equals or contains"),
        ("{contains: x}", "failure_reason takes either global_task or local_task"),
        ("{global_task: go($place), contains: 'a  b'}", "reasons are one line"),
        ("{global_task: go($place), contains: ''}", "at least 1 character"),
        ("{global_task: go($place), is: x}", "unknown key 'is'"),
    ],
)
def test_mistakes_are_told_with_their_line(given: str, message: str) -> None:
    with pytest.raises(FileError) as caught:
        conditions(MISSION.replace(GIVEN, f"failure_reason: {given}"))
    lines = [line for line in str(caught.value).splitlines() if message in line]
    assert lines, str(caught.value)
    assert lines[0].startswith("m.yaml:6: ")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("contains: bar}}", "contains: x}, default: true}", "m.yaml:6: .* is false at first"),
        (
            "clear: {}}\nconditions",
            "clear: {effects: {blocked(a): true}}}\nconditions",
            "m.yaml:3: .* no success sets it",
        ),
    ],
)
def test_only_failures_set_such_a_condition(old: str, new: str, message: str) -> None:
    with pytest.raises(FileError, match=f"^{message}"):
        conditions(MISSION.replace(old, new))
