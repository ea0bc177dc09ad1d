"""The order of jobs in teams that travel, and makespans of small missions against brute force.

    python -m benchmarks.task_order [--streams 200] [--missions 200] [--evaluations 300] [--seed 0]

Streams of jobs with priorities, deadlines and deaths, in the simulator: a judge that was written
from the documents reads what the robots recorded (`benchmarks.task_order_judge`), and another one
where they were (`benchmarks.task_order_delays`). With
`--horizon 1` robots make no schedules. Small missions: `benchmarks.small_missions`.
"""

from __future__ import annotations

import json
import random
import statistics
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from benchmarks.report import CORES, in_processes, run_program
from benchmarks.small_missions import SPEED, makespan_ratio, program_of, random_point, travel_of
from benchmarks.task_order_delays import Area, delays
from benchmarks.task_order_judge import Handed, Verdict, judge
from mrbt_mesh.core.agent import scheduler
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.sim.run import simulate
from mrbt_mesh.sim.world.faults import Fault, Kill, Operate
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US

US = 1_000_000
BEGIN_S, MARGIN_S = 3.0, 400.0
OVERTAKING = 5


def stream(seed: int, horizon: int = 100, evaluations: int = 300) -> Verdict:
    """One random stream of jobs, judged."""
    pick = random.Random(seed)
    names = [f"R{number}" for number in range(1, pick.randint(1, 5) + 1)]
    places = {f"p{n}": random_point(pick, 20) for n in range(8)}
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
    order = {"objective": objective, "horizon": horizon, "overtaking": OVERTAKING}
    mission: dict[str, Any] = {"mission": "order", "travel": travel_of(places, start) | order}
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
    small = [(n, partial(makespan_ratio, n)) for n in range(seed, seed + missions)]
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
        "above_1.1": sum(ratio > 1.1 for ratio in ratios),
        "worst_seed": seed + ratios.index(max(ratios)) if ratios else None,
    }


if __name__ == "__main__":
    run_program(__doc__, measure)
