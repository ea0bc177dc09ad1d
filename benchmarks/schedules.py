"""Schedules against published ones: tasks at places, for several robots that have to be together.

    python -m benchmarks.schedules --cases CASES.json [--evaluations 0 300 1000 3300] [--json FILE]

The cases are those of RALTestSet (HeteroMRTA, RA-L 2025) as JSON: places in the unit square, robots
that drive 0.2 of it in a second and return in the end, and for each case the time of CTAS-D, a
mixed-integer programme that was given 600 s. Printed is the time of our schedules as a ratio to it,
and the processor time of one search.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.report import run_program, say
from mrbt_mesh.core.scheduling.problem import (
    SchedulingNeed,
    SchedulingProblem,
    SchedulingTask,
    course_of,
)
from mrbt_mesh.core.scheduling.search import search

SPEED = 0.2
SEED = 1


def problem_of(case: Mapping[str, Any]) -> SchedulingProblem:
    """One case: first the places of the tasks, then those where the robots start."""
    tasks = [case["tasks"][name] for name in sorted(case["tasks"], key=int)]
    robots = [case["robots"][name] for name in sorted(case["robots"], key=int)]
    places = [each["at"] for each in (*tasks, *robots)]
    ways_ms = [[round(1e3 * math.dist(a, b) / SPEED) for b in places] for a in places]
    able: dict[int, list[int]] = {}
    for robot, each in enumerate(robots):
        able.setdefault(each["skill"], []).append(robot)
    home = tuple(range(len(tasks), len(places)))
    return SchedulingProblem(
        tuple(
            SchedulingTask(
                number,
                tuple(
                    SchedulingNeed(1, dict.fromkeys(able[skill], round(1e3 * each["duration_s"])))
                    for skill in each["skills"]
                ),
            )
            for number, each in enumerate(tasks)
        ),
        (0,) * len(robots),
        home,
        (ways_ms,) * len(robots),
        home,
    )


def measure(
    cases: str = "cases.json", evaluations: tuple[int, ...] = (0, 300, 1_000, 3_300)
) -> dict[str, Any]:
    """The mean and the worst ratio of all cases, for each number of evaluations."""
    found: list[Mapping[str, Any]] = json.loads(Path(cases).read_text())
    rows = []
    for count in evaluations:
        begun_s, ratios = time.process_time(), []
        for case in found:
            problem = problem_of(case)
            schedule = search(problem, count, SEED).schedule
            ratios.append(course_of(problem, schedule).cost / 1e3 / case["ctas_d"]["time"])
        row = {
            "evaluations": count,
            "mean": round(statistics.mean(ratios), 3),
            "worst": round(max(ratios), 3),
            "search_s": round((time.process_time() - begun_s) / len(found), 3),
        }
        say(f"{row}")
        rows.append(row)
    return {"rows": rows}


if __name__ == "__main__":
    run_program(__doc__, measure)
