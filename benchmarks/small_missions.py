"""Makespans of small random missions in the simulator, against the least possible ones.

Up to three robots, which may work at different speeds, and up to six tasks at places: for one robot
or two, of which some begin together, in any order or some after others. The least makespan is found
by trying everything. Written from docs/how-to/missions.md; of the product it uses the simulator.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import anyio

from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.run import simulate

US, TIMEOUT_US = 1_000_000, 300_000_000
SPEED, STEP_S, SIZE = 2.0, 0.2, 12
Point = tuple[float, float]


@dataclass(frozen=True)
class Task:
    """A task at a place for `count` robots; those of a coalition begin together. `after`: what has
    to end before any of its robots sets out. `work_s` is that of a robot of performance 1.
    """

    name: str
    place: str
    work_s: float
    count: int = 1
    is_together: bool = False
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class SmallMission:
    """`start` and `performance`: by robot. `tree`: in the words of mission files."""

    places: Mapping[str, Point]
    start: Mapping[str, str]
    performance: Mapping[str, float]
    tasks: tuple[Task, ...]
    tree: Mapping[str, Any]

    def text(self) -> str:
        """As a mission file."""
        travel = travel_of(self.places, self.start)
        capabilities = {
            name: {task.name: level for task in self.tasks}
            for name, level in self.performance.items()
        }
        mission = {
            "mission": "small",
            "travel": travel,
            "local_tasks": {
                task.name: {"work": task.work_s, "at": task.place} for task in self.tasks
            },
            "robot_types": {f"t{n}": {"capabilities": each} for n, each in capabilities.items()},
            "robots": {name: f"t{name}" for name in self.start},
            "global_tasks": {
                f"do_{task.name}": {
                    "simultaneous": task.is_together,
                    "needs": {task.name: {"min": task.count, "max": task.count}},
                }
                for task in self.tasks
            },
            "tree": self.tree,
        }
        return json.dumps(mission)


def travel_of(places: Mapping[str, Point], start: Mapping[str, str]) -> dict[str, Any]:
    """The `travel` of a mission file."""
    return {"places": {n: list(at) for n, at in places.items()}, "speed": SPEED, "start": start}


def random_point(pick: random.Random, size: int) -> Point:
    """In a square."""
    return round(pick.uniform(0, size), 3), round(pick.uniform(0, size), 3)


def small_mission(seed: int) -> SmallMission:
    """A random one."""
    pick = random.Random(seed)
    names = [f"R{number}" for number in range(1, pick.randint(1, 3) + 1)]
    places = {f"p{n}": random_point(pick, SIZE) for n in range(5)}
    start = {name: pick.choice(sorted(places)) for name in names}
    speeds = pick.choice([[1.0], [0.5, 1.0, 2.0]])
    performance = {name: pick.choice(speeds) for name in names}
    ids = [f"g{n}" for n in range(pick.randint(2, 6))]
    groups, tree = _groups(pick, ids)
    tasks = []
    for chain in groups:
        for position, group in enumerate(chain):
            after = tuple(name for before in chain[:position] for name in before)
            for name in group:
                count = 2 if len(names) > 1 and pick.random() < 0.3 else 1
                is_together = count > 1 and pick.random() < 0.7
                place, work_s = pick.choice(sorted(places)), round(pick.uniform(1, 8), 1)
                tasks.append(Task(name, place, work_s, count, is_together, after))
    return SmallMission(places, start, performance, tuple(tasks), tree)


def _groups(
    pick: random.Random, ids: Sequence[str]
) -> tuple[list[list[list[str]]], dict[str, Any]]:
    """Chains of groups of tasks, each group after those before it in its chain; and their tree."""
    shape = pick.choice(["any order", "any order", "two halves", "two chains"])
    cut = pick.randint(1, len(ids) - 1)
    if shape == "two halves":
        chains = [[list(ids[:cut]), list(ids[cut:])]]
    elif shape == "two chains":
        chains = [[[name] for name in ids[first::2]] for first in range(2)]
    else:
        chains = [[list(ids)]]
    trees = [{"Sequence": [_all([f"do_{n}" for n in group]) for group in each]} for each in chains]
    return chains, _all(trees)


def _all(children: Sequence[Any]) -> dict[str, Any]:
    return {"Parallel": {"success": "all", "children": children}}


def program_of(places: Mapping[str, Point], start: Mapping[str, str]) -> RobotProgram:
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


def makespan_ratio(seed: int) -> float:
    """The makespan of one random small mission, as a ratio to the least possible one."""
    of = small_mission(seed)
    result = simulate(
        mission_from_yaml(of.text(), __file__, Path()),
        program_of(of.places, of.start),
        seed=seed,
        timeout_us=TIMEOUT_US,
        inspect=False,
    )
    times_s = [float(event["t"]) for event in result.events]
    return (max(times_s) - min(times_s)) / least_makespan_s(of)


@dataclass(frozen=True)
class _State:
    """When and where each robot is free, and when each task that is done has ended."""

    free_s: tuple[float, ...]
    at: tuple[str, ...]
    ended_s: Mapping[str, float]

    def is_no_better(self, other: _State) -> bool:
        """Whether the other one, after the same tasks at the same places, is as good in all."""
        own = *self.free_s, *(self.ended_s[name] for name in sorted(self.ended_s))
        others = *other.free_s, *(other.ended_s[name] for name in sorted(self.ended_s))
        return all(b <= a for a, b in zip(own, others, strict=True))


def least_makespan_s(of: SmallMission) -> float:
    """Of all ways to order the tasks, and to choose the robots of each."""
    robots = list(of.start)
    seen: dict[tuple[frozenset[str], tuple[str, ...]], list[_State]] = {}
    best_s = math.inf

    def after(state: _State, task: Task, crew: Sequence[int]) -> _State:
        leaves_s = max([0.0, *(state.ended_s[name] for name in task.after)])
        goal = of.places[task.place]
        there_s = {
            r: max(state.free_s[r], leaves_s) + math.dist(of.places[state.at[r]], goal) / SPEED
            for r in crew
        }
        free_s, at = list(state.free_s), list(state.at)
        for robot in crew:
            begin_s = max(there_s.values()) if task.is_together else there_s[robot]
            free_s[robot] = begin_s + task.work_s / of.performance[robots[robot]]
            at[robot] = task.place
        end_s = max(free_s[robot] for robot in crew)
        return _State(tuple(free_s), tuple(at), {**state.ended_s, task.name: end_s})

    def go_on(state: _State) -> None:
        nonlocal best_s
        if max(state.ended_s.values(), default=0.0) >= best_s:
            return
        if len(state.ended_s) == len(of.tasks):
            best_s = max(state.ended_s.values())
            return
        known = seen.setdefault((frozenset(state.ended_s), state.at), [])
        if any(state.is_no_better(each) for each in known):
            return
        known.append(state)
        for task in of.tasks:
            if task.name not in state.ended_s and state.ended_s.keys() >= set(task.after):
                for crew in combinations(range(len(robots)), task.count):
                    go_on(after(state, task, crew))

    go_on(_State((0.0,) * len(robots), tuple(of.start.values()), {}))
    return best_s
