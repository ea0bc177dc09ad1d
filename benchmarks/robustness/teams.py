"""The teams: runs of the real agent class in virtual time, one per draw."""

from __future__ import annotations

import random
from dataclasses import replace
from functools import cache
from itertools import permutations
from pathlib import Path

import anyio

from benchmarks.robustness.draws import ACTIONS, NAMES, ROOMS, Draw
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.mission.mission import MICRO, Mission, Robot
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.context import RobotContext, TaskContext
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim import Block, Fault, KillAfter, SimulationResult, simulate

MISSION = Path(__file__).parent / "mission.yaml"
ACTION_S = 0.2
# Robots that hear nobody wait 1.2 s for the team before they go on alone, and the whole
# mission takes one robot ACTIONS * ACTION_S. A team still at work then is an error.
TIMEOUT_US = 5 * MICRO
ROBOTS = tuple(f"R{number}" for number in range(1, 9))

_EFFECTS = dict(
    zip(
        NAMES,
        [f"{what}({n + 1})" for what in ("opened", "moved") for n in range(ROOMS)],
        strict=True,
    )
)


class World:
    """The true state of the rooms and packages: the conditions that hold."""

    def __init__(self) -> None:
        self.holds: set[str] = set()
        self.changed = anyio.Event()

    def act(self, local_task: str) -> None:
        """An action is completed."""
        self.holds.add(_EFFECTS[local_task])
        self.changed.set()
        self.changed = anyio.Event()

    @property
    def is_done(self) -> bool:
        """Whether all rooms are open and all packages moved."""
        return len(self.holds) == ACTIONS


@cache
def _file() -> Mission:
    return load_mission(MISSION)


def _mission(performances: list[dict[str, int]]) -> Mission:
    robots = {
        robot: Robot(robot, "drawn", capabilities)
        for robot, capabilities in zip(ROBOTS, performances, strict=False)
    }
    return replace(_file(), robots=robots)


def our_team(draw: Draw) -> tuple[bool, float]:
    """Whether the team succeeds that shares its facts and its plan, and after how many seconds."""
    world = World()
    program = RobotProgram()

    @program.local_task("*")
    async def act(task: TaskContext) -> None:
        await anyio.sleep(ACTION_S)
        world.act(task.local_task)
        task.set_condition(_EFFECTS[task.local_task], True)

    able = [{NAMES[a]: MICRO for a in draw.capabilities(i)} for i in range(len(draw.lives))]
    result = _simulate(_mission(able), program, draw, [])
    plan = result.observer.plan
    done = plan is not None and plan.result is Status.SUCCESS
    if done != world.is_done:
        raise RuntimeError(f"seed {draw.seed}: the team and the world differ about success")
    if result.duration_us >= TIMEOUT_US and plan is not None and plan.assignments:
        raise RuntimeError(f"seed {draw.seed}: the team was still at work at the end")
    return done, result.duration_us / MICRO


def independent_robots(draw: Draw) -> bool:
    """Whether robots succeed that tell one another nothing.

    Each is a team of its own on the same tree. It sees rooms and packages when it chooses what to
    do, chooses by an order of preference of its own, drawn at random, and ends what it began; if
    another one was faster, it has worked in vain. Robots with nothing to do keep looking.
    """
    world = World()
    program = RobotProgram()
    busy: set[str] = set()

    @program.local_task("*")
    async def act(task: TaskContext) -> None:
        busy.add(task.robot)
        try:
            await anyio.sleep(ACTION_S)
            world.act(task.local_task)
            see(task)
        finally:  # also where it saw at the last moment that this was done already
            busy.remove(task.robot)

    @program.background
    async def look(context: RobotContext) -> None:
        while True:
            await world.changed.wait()
            if context.robot not in busy:
                see(context)

    def see(context: RobotContext) -> None:
        for condition in sorted(world.holds):
            if not context.read_condition(condition):
                context.set_condition(condition, True)

    able = []
    for i in range(len(draw.lives)):
        wishes = list(range(1, ACTIONS + 1))
        random.Random(f"independent/{draw.seed}/{i}").shuffle(wishes)
        able.append({NAMES[a]: wishes[a] * MICRO for a in draw.capabilities(i)})
    links = frozenset(permutations(ROBOTS[: len(draw.lives)], 2))
    _simulate(_mission(able), program, draw, [(0, Block(links))])
    if busy:
        raise RuntimeError(f"seed {draw.seed}: {', '.join(sorted(busy))} still acted at the end")
    return world.is_done


def _simulate(
    mission: Mission, program: RobotProgram, draw: Draw, steps: list[tuple[int, Fault]]
) -> SimulationResult:
    deaths = [(0, KillAfter(r, n)) for r, n in zip(ROBOTS, draw.lives, strict=False)]
    return simulate(
        mission,
        program,
        seed=draw.seed,
        schedule=[*steps, *deaths],
        timeout_us=TIMEOUT_US,
        stop_when_stuck=True,
        inspect=False,
    )
