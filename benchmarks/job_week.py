"""Jobs for a week, in virtual time: does anything grow with the jobs that a team has done?

    python -m benchmarks.job_week [--count 200000] [--seconds 604800] [--seed 1] [--json FILE]

Three robots do jobs of two types that come one by one, all day and night. Of each tenth of the time
the figures are, for one robot:

facts, journal   entries in its map and in its journal, at the end of the tenth
archived         how many ended jobs it knows by their hashes alone (at most 100,000)
kib              what its facts occupy in memory
batch_bytes      the mean message with facts that it has sent, and the largest one
plan_us          the mean time of a plan: the least CPU time of three, of a sample

Ended jobs are archived by the hundred, so facts come and go between two archives. The exit status
is 1 if a job is open at the end, or a figure of the last tenth is more than twice that of the
second one.
"""

from __future__ import annotations

import gc
import random
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import mean
from types import FunctionType, ModuleType
from typing import Any

import anyio

from benchmarks.report import run_program, say
from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.agent.effects import Effect, Publish
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.sim.world.clock import VirtualLoop
from mrbt_mesh.sim.world.faults import Operate
from mrbt_mesh.sim.world.process import Inspection, SimProcess
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US, AgentOptions, Setup
from mrbt_mesh.sim.world.sharing import shared_engine
from mrbt_mesh.sim.world.world import World

MISSION = """
mission: job_week
ends: never
local_tasks:
  look: {parameters: [shelf], work: 2, sets: [found]}
  take: {parameters: [what], work: 2}
  put: {parameters: [shelf], work: 2}
blackboard: {found: {values: [red, blue], per: job}}
robot_types: {cart: {capabilities: {look: 1, take: 1, put: 1}}}
robots: {A1: cart, A2: cart, A3: cart}
global_tasks:
  look: {parameters: [shelf], needs: {look($shelf): {}}}
  fetch: {parameters: [what], needs: {take($what): {}}}
  bring: {parameters: [shelf], needs: {put($shelf): {}}}
jobs:
  sort:
    parameters: {shelf: {min: 1, max: 9}}
    tree: {Sequence: [look($shelf), {Condition: found == red}, fetch($found)]}
  bring: {parameters: {shelf: {min: 1, max: 9}}, priority: 1, tree: bring($shelf)}
tree: {Jobs: all}
"""
US = 1_000_000
BEGIN_S = 10.0
TENTHS = 10
# Of this many plans one is timed.
SAMPLED = 50
# A robot that is heard every minute is enough where none dies.
TIMING = Timing(heartbeat_us=60 * US, detection_us=240 * US)
GROWTH = 2.0


def occupied_kib(facts: TeamFacts) -> float:
    """What the objects of a robot's facts occupy, without its mission."""
    seen, waiting, total = {id(facts.in_force), id(facts.mission)}, [facts], 0
    while waiting:
        each: Any = waiting.pop()
        if id(each) in seen or isinstance(each, type | ModuleType | FunctionType | Mission):
            continue
        seen.add(id(each))
        total += sys.getsizeof(each)
        waiting.extend(gc.get_referents(each))
    return total / 1024


class Figures(Inspection):
    """The figures of each tenth, of the first robot."""

    def __init__(self, world: World, seconds: float) -> None:
        super().__init__()
        self.tenths: list[dict[str, float]] = []
        self._world = world
        self._tenth_us = seconds * US / TENTHS
        self._sizes: list[int] = []
        self._plans_us: list[float] = []
        self._steps = 0
        self._journal: set[tuple[str, str]] = set()

    def synced(self, process: SimProcess, changes: Any) -> None:
        if process.robot == "A1":
            self._journal |= {key for key, entry in changes.items() if entry is not None}
            self._journal -= {key for key, entry in changes.items() if entry is None}

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        if process.robot != "A1" or process.agent is None:
            return
        for effect in effects:
            if isinstance(effect, Publish) and effect.kind is MessageKind.FACT:
                self._sizes.append(len(effect.data))
        self._steps += 1
        view = process.agent.view
        if self._steps % SAMPLED == 0:
            self._plans_us.append(_plan_us(view.facts, view.alive()))
        done = len(self.tenths)
        if done < TENTHS and self._world.clock.now_us >= self._tenth_us * (done + 1):
            self._note(view.facts)

    def _note(self, facts: TeamFacts) -> None:
        assert facts.jobs is not None
        self.tenths.append(
            {
                "facts": len(facts.map),
                "journal": len(self._journal),
                "archived": facts.jobs.count_archived(),
                "kib": round(occupied_kib(facts)),
                "batch_bytes": round(mean(self._sizes)),
                "largest_batch": max(self._sizes),
                "plan_us": round(mean(self._plans_us)),
            }
        )
        say(f"{len(self.tenths)}/{TENTHS}: {self.tenths[-1]}")
        self._sizes.clear()
        self._plans_us.clear()


def _plan_us(facts: TeamFacts, alive: Any) -> float:
    times = []
    for _ in range(3):
        started_s = time.process_time()
        make_plan(facts, alive, default_solver)
        times.append(time.process_time() - started_s)
    return min(times) * US


async def _work(task: TaskContext, *arguments: str) -> dict[str, str]:
    await anyio.sleep(task.simulation.duration_s)
    is_red = int(arguments[0]) % 2 if task.local_task.startswith("look") else 0
    return {"found": "red" if is_red else "blue"} if task.local_task.startswith("look") else {}


def run(count: int = 200_000, seconds: float = 604_800, seed: int = 1) -> dict[str, Any]:
    """Hand in `count` jobs over a span of virtual seconds."""
    mission, program, pick = (
        mission_from_yaml(MISSION, "job_week", Path()),
        RobotProgram(),
        random.Random(seed),
    )
    for name in mission.local_tasks:
        program.local_task(name)(_work)
    schedule = []
    for number in range(count):
        at_us = round((BEGIN_S + (seconds - BEGIN_S) * (number + pick.random()) / count) * US)
        kind, shelf = pick.choice(["sort", "bring"]), str(pick.randint(1, 9))
        usual = mission.jobs[kind]
        deadline_us = 0
        if usual.deadline_us is not None:
            deadline_us = LAUNCH_UNIX_US + at_us + usual.deadline_us
        value = [kind, [shelf], usual.priority, 0, deadline_us, number]
        robot = pick.choice(["A1", "A2", "A3"])
        schedule.append((at_us, Operate(robot, f"job/job-{number}", value, "me")))
    timeout_us = round((seconds + 600) * US)
    robots = tuple(sorted(mission.robots))
    setup = Setup(mission, program, seed, robots, timeout_us, tuple(schedule))
    agents = AgentOptions(TIMING, shared_engine(setup.header, setup.agents.engine))
    setup = Setup(mission, program, seed, robots, timeout_us, tuple(schedule), agents=agents)
    found: list[Figures] = []

    def inspected(world: World) -> Inspection:
        found.append(Figures(world, seconds))
        return found[0]

    world = World(setup, inspected, None)
    started_s = time.monotonic()
    options = {"loop_factory": lambda: VirtualLoop(world.clock)}
    anyio.run(world.main, backend_options=options)
    known = world.observer.facts.jobs
    assert known is not None
    tenths = found[0].tenths
    second, last = tenths[1], tenths[-1]
    grown = [name for name in second if name != "archived" and last[name] > GROWTH * second[name]]
    return {
        "jobs": count,
        "open_at_the_end": known.count_open(),
        "real_s": round(time.monotonic() - started_s),
        "tenths": tenths,
        "grown": grown,
    }


if __name__ == "__main__":
    figures = run_program(__doc__, run)
    raise SystemExit(1 if figures["grown"] or figures["open_at_the_end"] else 0)
