"""Teams that travel, against published schedules: what their robots physically do.

    python -m benchmarks.allocation CASES.json [--plain] [--noise 0.3] [--deaths 1] [--events DIR]

The cases are those of RALTestSet (HeteroMRTA, RA-L 2025) as JSON: 15 robots that drive 0.2 of the
unit square in a second, 20 tasks for robots of several kinds that have to be there together, and
for each case the time of CTAS-D, a mixed-integer programme that was given 600 s. The real agents
run in the simulator. Printed is the time of each mission, from when the first robot sets out until
the last one is back at its start, as a ratio to that of CTAS-D.

`--plain`: without schedules, each robot bids minus its way for each task. `--noise 0.3`: ways and
works take up to 30 % longer or shorter than the robots know. `--deaths 1`: one robot, not the last
of its kind, is killed in the middle of the mission. `--events DIR`: what the robots did, one file
for each case, as `mrbt sim --events` writes it.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import anyio

from benchmarks.report import CORES, in_processes
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, build_tree
from mrbt_mesh.core.mission.mission import (
    MICRO,
    GlobalTask,
    LocalTask,
    Mission,
    Need,
    Robot,
)
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.features.bids.needs import BidRule
from mrbt_mesh.features.exclusive.policy import CoalitionPolicy
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.run import simulate
from mrbt_mesh.sim.world.faults import Fault, Kill

SPEED = 0.2
SEED = 1
TIMEOUT_S = 300.0


def cases_of(path: Path) -> list[dict[str, Any]]:
    """The cases in a file. Raises OSError, and ValueError for a file of another format."""
    cases = json.loads(path.read_text())
    try:
        for case in cases:
            mission_of(case, plain=False)
            float(case["ctas_d"]["time"])
    except (TypeError, KeyError, AttributeError, IndexError, ArithmeticError) as error:
        what = f"{type(error).__name__}: {error}"
        raise ValueError(f"not a file of RALTestSet cases as JSON ({what})") from None
    if not cases:
        raise ValueError("it has no cases")
    return list(cases)


def mission_of(case: Mapping[str, Any], plain: bool) -> Mission:
    """One case as a mission; a robot of a skill works at its own pace on each task."""
    tasks, robots = case["tasks"], case["robots"]
    needs = {
        number: [f"skill_{skill}({number})" for skill in each["skills"]]
        for number, each in tasks.items()
    }
    paces = {
        name: round(MICRO / tasks[number]["duration_s"])
        for number, names in needs.items()
        for name in names
    }
    skills = sorted({each["skill"] for each in robots.values()})
    team = {}
    for number, each in robots.items():
        kind = f"skill_{each['skill']}"
        able = {name: pace for name, pace in paces.items() if name.startswith(f"{kind}(")}
        team[f"R{number}"] = Robot(f"R{number}", kind, able)
    places = {f"task_{n}": _point(each) for n, each in tasks.items()}
    places |= {f"start_{n}": _point(each) for n, each in robots.items()}
    leaves = tuple(NodeSpec(Kind.ACTION, subject=f"task({number})") for number in needs)
    return Mission(
        name=f"case_{case['case']}",
        robots=team,
        robot_types={f"skill_{skill}": {} for skill in skills},
        local_tasks={f"skill_{skill}": LocalTask(f"skill_{skill}", ("task",)) for skill in skills},
        conditions={},
        global_tasks={
            f"task({number})": GlobalTask(
                f"task({number})",
                tuple(Need(name, 1, 1, None, BidRule() if plain else None) for name in names),
                joint=CoalitionPolicy(simultaneous=True),
            )
            for number, names in needs.items()
        },
        tree=build_tree(NodeSpec(Kind.PARALLEL, leaves, limit=len(leaves))),
        travel=Travel(
            places,
            {name: f"task_{number}" for number, names in needs.items() for name in names},
            {f"R{number}": f"start_{number}" for number in robots},
            {f"skill_{skill}": round(SPEED * MICRO) for skill in skills},
            has_way_back=True,
        ),
    )


def _point(each: Mapping[str, Any]) -> tuple[int, int]:
    x, y = each["at"]
    return round(x * MICRO), round(y * MICRO)


def program_of(mission: Mission) -> RobotProgram:
    """Robots that work for as long as the mission says, and bid minus their way."""
    program = RobotProgram(record_work=True)

    @program.local_task("*")
    async def work(task: TaskContext, number: str) -> None:
        await anyio.sleep(task.simulation.duration_s)

    @program.bid("*")
    def bid(task: TaskContext, number: str) -> float:
        travel = mission.travel
        assert travel is not None
        origin = travel.start[task.robot]
        return -travel.way_ms(task.robot_type, origin, f"task_{number}") / 1e3

    return program


def deaths_of(case: Mapping[str, Any], count: int) -> list[tuple[int, Fault]]:
    """Robots of kinds that have others, killed in the middle of the published time."""
    draw = random.Random(int(case["case"]))
    kinds: dict[int, list[str]] = {}
    for number, each in case["robots"].items():
        kinds.setdefault(each["skill"], []).append(f"R{number}")
    able = [draw.choice(names) for _, names in sorted(kinds.items()) if len(names) > 1]
    draw.shuffle(able)
    middle_us = case["ctas_d"]["time"] * 1e6
    return [(round(middle_us * draw.uniform(0.25, 0.5)), Kill(robot)) for robot in able[:count]]


def run(
    case: Mapping[str, Any], plain: bool, noise: float, deaths: int, events: Path | None
) -> dict[str, Any]:
    """One mission: its time in seconds, way back included, and as a ratio."""
    begun_s = time.process_time()
    mission = mission_of(case, plain)
    result = simulate(
        mission,
        program_of(mission),
        seed=SEED,
        schedule=deaths_of(case, deaths),
        timeout_us=round(TIMEOUT_S * 1e6),
        inspect=False,
        noise_permille=round(noise * 1_000),
    )
    if events is not None:
        result.write_events(events / f"{case['case']}.jsonl")
    taken_s = mission_s(mission, result.events)
    published_s = case["ctas_d"]["time"]
    return {
        "case": case["case"],
        "result": result.result,
        "time_s": round(taken_s, 3),
        "ratio": round(taken_s / published_s, 4),
        "processor_s": round(time.process_time() - begun_s, 2),
    }


def mission_s(mission: Mission, events: Sequence[Mapping[str, Any]]) -> float:
    """From when the first robot sets out until the last one is back at its start."""
    travel, back_s = mission.travel, 0.0
    assert travel is not None
    begun_s: float = min(each["t"] for each in events if each["event"] == "start")
    last: dict[str, Mapping[str, Any]] = {}
    for each in events:
        if each["outcome"] == "success":
            last[each["robot"]] = each
    for robot, each in last.items():
        place = f"task_{each['args'][0]}"
        way_ms = travel.way_ms(mission.robots[robot].type, place, travel.start[robot])
        back_s = max(back_s, each["t"] + way_ms / 1e3)
    return back_s - begun_s


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", type=Path, metavar="CASES.json")
    parser.add_argument("--plain", action="store_true", help="without schedules")
    parser.add_argument("--noise", type=float, default=0.0, metavar="PART", help="(0)")
    parser.add_argument("--deaths", type=int, default=0, metavar="COUNT", help="(0)")
    parser.add_argument("--events", type=Path, metavar="DIR", help="write what the robots did here")
    parser.add_argument("--jobs", type=int, default=CORES, help=f"({CORES})")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args()
    try:
        cases = cases_of(options.cases)
    except (OSError, ValueError) as error:
        parser.error(f"{options.cases}: {error}")
    if not 0 <= options.noise < 1 or options.deaths < 0 or options.jobs < 1:
        parser.error("--noise is from 0 to below 1, --deaths at least 0, and --jobs at least 1")
    if options.events is not None:
        options.events.mkdir(parents=True, exist_ok=True)
    how = options.plain, options.noise, options.deaths, options.events
    calls = [(number, partial(run, case, *how)) for number, case in enumerate(cases)]
    found = dict(in_processes(calls, options.jobs))
    rows = [found[number] for number in range(len(cases))]
    figures = {"rows": rows, "mean": round(statistics.mean(row["ratio"] for row in rows), 4)}
    if options.json:
        json.dump(figures, sys.stdout, indent=1)
        sys.stdout.write("\n")
    else:
        sys.stdout.write(f"mean {figures['mean']:.3f} of CTAS-D, {len(rows)} cases\n")


if __name__ == "__main__":
    main()
