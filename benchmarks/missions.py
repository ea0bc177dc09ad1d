"""The missions of the benchmarks' teams: robots that patrol areas, or that have nothing to do."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

# An action that takes this long never ends while something is measured.
NEVER_S = 1_000_000.0
_PROGRAM = """\
import anyio
from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)


@robot.local_task("*")
async def work(task: TaskContext, *arguments: str) -> None:
    await anyio.sleep({work_s})
"""


def write_patrol(
    folder: Path,
    robots: Sequence[str],
    areas: Sequence[str],
    work_s: float = NEVER_S,
    *,
    again: bool = False,
    cells: Sequence[str] = (),
    program: str = "",
    **parameters: Any,
) -> Path:
    """Robots explore areas, one robot each, once or `again` and again; returns the mission's file.

    `cells`: there is a condition for each. `parameters`: more parameters of the mission.
    """
    visit: Any = "visit($area)"
    mission = {
        "mission": "patrol",
        "parameters": {"areas": list(areas), "cells": list(cells), **parameters},
        "conditions": {"seen": {"parameters": ["cell"]}} if cells else {},
        "local_tasks": {"explore": {"parameters": ["area"], "work": work_s}},
        "robot_types": {"R": {"capabilities": {"explore": 1}}},
        "robots": dict.fromkeys(robots, "R"),
        "global_tasks": {
            "visit": {"parameters": ["area"], "needs": {"explore($area)": {"min": 1, "max": 1}}}
        },
        "tree": {
            "Parallel": {
                "success": "all",
                "for_each": {"area": "$areas"},
                "do": {"Repeat": {"cycles": -1, "do": visit}} if again else visit,
            }
        },
    }
    return write_mission(folder, mission, program or _PROGRAM.format(work_s=work_s))


def write_rest(folder: Path, robots: Sequence[str]) -> Path:
    """Robots wait for a condition that never holds; returns the mission's file."""
    wanted = {"Inverter": {"Condition": "wanted"}}
    mission = {
        "mission": "at_rest",
        "local_tasks": {"wait": {"work": 1}},
        "conditions": {"wanted": {"default": False}},
        "robot_types": {"R": {"capabilities": {"wait": 1}}},
        "robots": dict.fromkeys(robots, "R"),
        "global_tasks": {"work": {"needs": {"wait": {"min": 1}}}},
        "tree": {"KeepRunningUntilFailure": {"Fallback": [wanted, "work"]}},
    }
    return write_mission(folder, mission, _PROGRAM.format(work_s=1.0))


def write_mission(folder: Path, mission: dict[str, Any], program: str) -> Path:
    """Write a mission and its program; JSON is YAML, too."""
    (folder / "robot.py").write_text(program)
    file = folder / "mission.yaml"
    file.write_text(json.dumps({**mission, "program": "robot.py"}))
    return file
