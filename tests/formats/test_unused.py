"""Warnings of what a mission file declares and nothing uses."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.formats.unused import unused_declarations
from tests.support.paths import EXAMPLES

MISSION = """\
mission: m
program: robot.py
parameters: {rooms: [r1, r2], speed: 2, map: {}, kind: red}
local_tasks:
  fetch: {parameters: [what], work: 1}
  paint_red: {}
  spare: {}
conditions:
  ready: {}
  told: {}
  lost: {}
robot_types:
  robot: {capabilities: {"fetch($rooms)": 1.0, paint_red: 1.0}}
  old: {capabilities: {paint_red: 1.0}}
robots: {A1: robot}
global_tasks:
  get:
    parameters: [room, colour]
    needs: {fetch($room): {min: 1}}
  paint: {needs: {paint_$kind: {min: 1}}}
  forgotten: {needs: {paint_red: {min: 1}}}
subtrees:
  visit: {parameters: [room], tree: {Action: "get($room, red)"}}
  idle: {tree: paint}
tree:
  Sequence:
    - Condition: ready
    - SubTree: visit(r1)
    - paint
"""
FOUND = {
    "local_tasks/spare": "line 7: the local task 'spare' is declared and nothing uses it",
    "lost": "line 11: the condition 'lost' is declared and nothing uses it",
    "old": "line 14: the robot type 'old'",
    "colour": "line 18: the parameter 'colour' of 'get'",
    "forgotten": "line 21: the global task 'forgotten'",
    "idle": "line 24: the subtree 'idle'",
    "rooms": "line 3: the parameter 'speed' is declared",
}
ROBOT = "def told(task):\n    return task.set_condition('told', True)\n"


def test_what_nothing_uses_is_told_with_its_line(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(MISSION)
    (tmp_path / "robot.py").write_text(ROBOT)
    found = unused_declarations(mission, str(tmp_path / "robot.py") + ":robot")
    assert len(found) == len(FOUND), found
    for expected in FOUND.values():
        assert any(text.startswith(expected) and "remove it" in text for text in found), expected


def test_without_a_program_nothing_is_said_of_what_programs_may_use(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(MISSION)
    found = " ".join(unused_declarations(mission, None))
    assert "'spare'" in found
    assert "'lost'" not in found
    assert "'speed'" not in found


JOBS = """\
mission: m
local_tasks: {fetch: {}}
robot_types: {robot: {capabilities: {fetch: 1.0}}}
robots: {A1: robot}
global_tasks: {get: {needs: {fetch: {min: 1}}}}
jobs:
  one: {parameters: {n: [1, 2]}, tree: get}
  two: {tree: get}
tree: %s
"""


@pytest.mark.parametrize(
    ("node", "unused"),
    [
        ("{Jobs: {types: [one]}}", ["two"]),
        ("{Jobs: [one]}", ["two"]),
        ("Jobs", []),
        ("{Jobs: all}", []),
        ("{Jobs: {at_most: 3}}", []),
        ("{Jobs: {types: all, at_most: 3}}", []),
    ],
)
def test_types_of_jobs(node: str, unused: list[str], tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    mission.write_text(JOBS % node)
    found = [text for text in unused_declarations(mission, None) if "type of jobs" in text]
    assert len(found) == len(unused)
    assert all(repr(name) in text for name, text in zip(unused, found, strict=True))


@pytest.mark.parametrize(
    "mission", sorted(EXAMPLES.glob("*/mission.yaml")), ids=lambda path: path.parent.name
)
def test_the_examples_use_all_that_they_declare(mission: Path) -> None:
    assert not unused_declarations(mission, load_mission(mission).program)
