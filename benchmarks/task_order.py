"""The order of jobs in teams that travel, and makespans of small missions against brute force.

    python -m benchmarks.task_order [--streams 200] [--missions 200] [--evaluations 300] [--seed 0]

Streams of jobs with priorities, deadlines and deaths, in the simulator: a judge that was written
from the documents reads what the robots recorded (`benchmarks.task_order_judge`), and another one
where they were (`benchmarks.task_order_delays`). With
`--horizon 1` robots make no schedules. Small missions are two or three robots and up to six tasks;
the least possible makespan is found by trying all schedules.
"""

from __future__ import annotations

import json
import math
import random
import statistics
from collections.abc import Sequence
from functools import partial
from itertools import permutations, product
from pathlib import Path
from typing import Any
from unittest import mock

import anyio

from benchmarks.report import CORES, in_processes, run_program
from benchmarks.task_order_delays import Area, delays
from benchmarks.task_order_judge import Handed, Verdict, judge
from mrbt_mesh.core.agent import scheduler
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.run import simulate
from mrbt_mesh.sim.world.faults import Fault, Kill, Operate
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US

US = 1_000_000
SPEED, STEP_S, BEGIN_S, MARGIN_S = 2.0, 0.2, 3.0, 400.0
OVERTAKING = 5
Point = tuple[float, float]


def program_of(places: dict[str, Point], start: dict[str, str]) -> RobotProgram:
    """Robots that drive straight, step by step, and turn where they are."""
    program, here = RobotProgram(record_work=True), dict[tuple[str, int], Point]()

    @program.travel
    async def drive(task: TaskContext, place: str) -> None:
        key = task.robot, task.simulation.pid
        (ax, ay), (bx, by) = here.get(key, places[start[task.robot]]), places[place]
        way_s = math.dist((ax, ay), (bx, by)) / SPEED
        count = max(1, math.ceil(way_s / STEP_S))
        for number in range(1, count + 1):
            await anyio.sleep(way_s / count)
            part = number / count
            here[key] = ax + (bx - ax) * part, ay + (by - ay) * part

    @program.local_task("*")
    async def work(task: TaskContext, *_: str) -> None:
        await anyio.sleep(task.simulation.duration_s)

    return program


def _point(pick: random.Random, size: int) -> Point:
    return round(pick.uniform(0, size), 3), round(pick.uniform(0, size), 3)


def _header(places: dict[str, Point], start: dict[str, str], **more: object) -> dict[str, Any]:
    travel = {"places": {name: list(at) for name, at in places.items()}, "speed": SPEED}
    return {"mission": "order", "travel": {**travel, "start": start, **more}}


# -- streams --------------------------------------------------------------------------------------


def stream(seed: int, horizon: int = 100, evaluations: int = 300) -> Verdict:
    """One random stream of jobs, judged."""
    pick = random.Random(seed)
    names = [f"R{number}" for number in range(1, pick.randint(1, 5) + 1)]
    places = {f"p{n}": _point(pick, 20) for n in range(8)}
    start = {name: pick.choice(sorted(places)) for name in names}
    kinds = {name: pick.choice(["both", "both", "left"]) for name in names}
    able = {
        "one": frozenset(names),
        "right": frozenset(name for name in names if kinds[name] == "both") or frozenset(names),
        "pair": frozenset(names),
    }
    kinds = {name: "both" if name in able["right"] else "left" for name in names}
    works = {kind: pick.uniform(0.5, 4) for kind in able}
    killed_s: dict[str, float] = {}
    if len(names) > 2 and pick.random() < 0.4:
        killed_s = {pick.choice(sorted(names)): pick.uniform(8, 40)}
        if not able["right"] - killed_s.keys():
            killed_s = {}
    objective = pick.choice(["makespan", "mean_completion"])
    mission = _header(places, start, objective=objective, horizon=horizon, overtaking=OVERTAKING)
    local = {kind: {"parameters": ["n", "p"], "work": round(works[kind], 2)} for kind in able}
    mission |= {
        "ends": "never",
        "local_tasks": {kind: {**each, "at": "$p"} for kind, each in local.items()},
        "robot_types": {
            "both": {"capabilities": dict.fromkeys(able, 1)},
            "left": {"capabilities": {"one": 1, "pair": 1}},
        },
        "robots": kinds,
        "global_tasks": {
            f"do_{kind}": {
                "parameters": ["n", "p"],
                "simultaneous": kind == "pair",
                "needs": {
                    f"{kind}($n, $p)": {"min": 1 + (kind == "pair"), "max": 1 + (kind == "pair")}
                },
            }
            for kind in able
        },
        "jobs": {
            kind: {
                "parameters": {"n": {"min": 1, "max": 99}, "p": "place"},
                "tree": f"do_{kind}($n, $p)",
            }
            for kind in able
        },
        "tree": {"Jobs": {"types": "all", "at_most": 50}},
    }
    jobs, schedule, at_s = list[Handed](), list[tuple[int, Fault]](), BEGIN_S
    gap_s = pick.uniform(0.5, 5) / len(names)
    levels = pick.choice([[0], [0, 0, 5], [0, 1, 2, 3]])
    near = sorted(places)[:3]
    for number in range(1, pick.randint(10, 30)):
        at_s += pick.expovariate(1 / gap_s)
        kind = pick.choice(["one", "one", "one", "right", "pair" if len(names) > 2 else "one"])
        place = pick.choice(near if pick.random() < 0.6 else sorted(places))
        deadline_s = at_s + pick.uniform(8, 60) if pick.random() < 0.3 else None
        count = 2 if kind == "pair" else 1
        what = able[kind], count, deadline_s, place, round(works[kind], 2)
        job = Handed(f"j{number}", at_s, pick.choice(levels), *what)
        deadline_us = 0 if deadline_s is None else LAUNCH_UNIX_US + round(deadline_s * US)
        value = [kind, [str(number), place], job.priority, 0, deadline_us, number]
        taker = next(name for name in names if name not in killed_s)
        schedule.append((round(at_s * US), Operate(taker, f"job/{job.id}", value)))
        jobs.append(job)
    schedule += [(round(when_s * US), Kill(name)) for name, when_s in killed_s.items()]
    with mock.patch.object(scheduler, "evaluations_of", return_value=evaluations):
        result = simulate(
            mission_from_yaml(json.dumps(mission), __file__, Path()),
            program_of(places, start),
            seed=seed,
            schedule=sorted(schedule, key=lambda each: each[0]),
            timeout_us=round((at_s + MARGIN_S) * US),
            inspect=False,
        )
    found = judge(jobs, result.events, killed_s, OVERTAKING)
    found.broken += delays(jobs, result.events, killed_s, Area(places, start, SPEED))
    return found


# -- small missions -------------------------------------------------------------------------------


def small_mission(seed: int, evaluations: int = 300) -> float:
    """The makespan of one random small mission, as a ratio to the least possible one."""
    pick = random.Random(seed)
    names = [f"R{number}" for number in range(1, pick.randint(2, 3) + 1)]
    places = {f"p{n}": _point(pick, 12) for n in range(5)}
    start = {name: pick.choice(sorted(places)) for name in names}
    tasks = [
        (f"g{n}", pick.choice(sorted(places)), round(pick.uniform(1, 8), 1))
        for n in range(pick.randint(2, 6))
    ]
    mission = _header(places, start) | {
        "local_tasks": {name: {"work": work_s, "at": at} for name, at, work_s in tasks},
        "robot_types": {"all": {"capabilities": {name: 1 for name, _, _ in tasks}}},
        "robots": dict.fromkeys(names, "all"),
        "global_tasks": {f"do_{n}": {"needs": {n: {"min": 1, "max": 1}}} for n, _, _ in tasks},
        "tree": {"Parallel": {"success": "all", "children": [f"do_{n}" for n, _, _ in tasks]}},
    }
    with mock.patch.object(scheduler, "evaluations_of", return_value=evaluations):
        result = simulate(
            mission_from_yaml(json.dumps(mission), __file__, Path()),
            program_of(places, start),
            seed=seed,
            timeout_us=300 * US,
            inspect=False,
        )
    times_s = [float(event["t"]) for event in result.events]
    best_s = least_makespan_s([places[start[name]] for name in names], tasks, places)
    return (max(times_s) - min(times_s)) / best_s


def least_makespan_s(
    starts: Sequence[Point], tasks: Sequence[tuple[str, str, float]], places: dict[str, Point]
) -> float:
    """Of all ways to share tasks out and to order them."""

    def route_s(robot: int, chosen: tuple[int, ...]) -> float:
        shortest_s = math.inf
        for order in permutations(chosen):
            here, taken_s = starts[robot], 0.0
            for number in order:
                _, place, work_s = tasks[number]
                taken_s += math.dist(here, places[place]) / SPEED + work_s
                here = places[place]
            shortest_s = min(shortest_s, taken_s)
        return shortest_s

    known: dict[tuple[int, tuple[int, ...]], float] = {}
    best_s = math.inf
    for owners in product(range(len(starts)), repeat=len(tasks)):
        longest_s = 0.0
        for robot in range(len(starts)):
            key = robot, tuple(n for n, owner in enumerate(owners) if owner == robot)
            if key not in known:
                known[key] = route_s(*key)
            longest_s = max(longest_s, known[key])
        best_s = min(best_s, longest_s)
    return best_s


def measure(
    streams: int = 200,
    missions: int = 200,
    evaluations: int = 300,
    horizon: int = 100,
    seed: int = 0,
    jobs: int = CORES,
) -> dict[str, Any]:
    """The figures of all streams and missions."""
    calls = [(n, partial(stream, n, horizon, evaluations)) for n in range(seed, seed + streams)]
    verdicts = dict(in_processes(calls, jobs))
    small = [(n, partial(small_mission, n, evaluations)) for n in range(seed, seed + missions)]
    ratios = [ratio for _, ratio in sorted(in_processes(small, jobs))]
    return {
        "streams": streams,
        "broken": {n: each.broken for n, each in sorted(verdicts.items()) if each.broken},
        "done": sum(each.done for each in verdicts.values()),
        "most_overtaken": max(
            (max(v.overtaken.values(), default=0) for v in verdicts.values()), default=0
        ),
        "turns": sum(each.turns for each in verdicts.values()),
        "turns_back": sum(each.turns_back for each in verdicts.values()),
        "missed": sum(sum(each.missed.values()) for each in verdicts.values()),
        "missions": missions,
        "mean": round(statistics.mean(ratios), 4) if ratios else None,
        "worst": round(max(ratios), 4) if ratios else None,
        "worst_seed": seed + ratios.index(max(ratios)) if ratios else None,
    }


if __name__ == "__main__":
    run_program(__doc__, measure)
