"""A stream of jobs with deadlines, in virtual time, accounted for by what robots physically did.

    python -m benchmarks.job_stream [--count 600] [--seconds 3600] [--seed 1] [--json FILE]

Jobs of three types come one by one and in bursts, with deadlines of 2 to 10 minutes; some are
cancelled. Robots die at work and start again, and the wall clock of one is set wrongly now and
then. `account` reads nothing but the submissions and the begins and ends of work. Its rules:

- A job is done if each of its tasks has succeeded, each once. None does so twice.
- A job that is not done has been cancelled, or its deadline has passed.
- After its deadline, or after it was cancelled, none of its tasks begins, and what ran was
  cancelled, but for what ended in the `SLACK_S` that the news takes to the robot.

The exit status is 1 if a rule is broken.
"""

from __future__ import annotations

import random
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio

from benchmarks.report import run_program
from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.sim import Fault, Kill, Restart, SetWallClock, simulate
from mrbt_mesh.sim.world.faults import Operate
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US

MISSION = """
mission: job_stream
ends: never
local_tasks:
  take: {parameters: [number], work: 24}
  put: {parameters: [number], work: 24}
  dose: {parameters: [number], work: 30}
  look: {parameters: [number], work: 25}
robot_types:
  cart: {capabilities: {take: 1, put: 1, dose: 1}}
  scout: {capabilities: {look: 1, dose: 1}}
robots: {A1: cart, A2: cart, A3: cart, A4: cart, B1: scout, B2: scout}
global_tasks:
  fetch: {parameters: [number], needs: {take($number): {}}}
  bring: {parameters: [number], needs: {put($number): {}}}
  dose: {parameters: [number], needs: {dose($number): {}}, exclusive: true, in_doubt: retry}
  look: {parameters: [number], needs: {look($number): {}}}
jobs:
  deliver:
    parameters: {number: {min: 1, max: 9}}
    tree: {Sequence: [fetch($number), bring($number)]}
  dose: {parameters: {number: {min: 1, max: 9}}, priority: 2, tree: dose($number)}
  look: {parameters: {number: {min: 1, max: 9}}, tree: look($number)}
tree: {Jobs: {types: all, at_most: 20}}
"""
# The work of each type.
TASKS = {"deliver": ("put", "take"), "dose": ("dose",), "look": ("look",)}
US = 1_000_000
BEGIN_S = 5.0
# A clock that is believed is up to a second off; the news takes a heartbeat.
SLACK_S = 1.5


@dataclass(frozen=True)
class Submitted:
    """A job, and when it was cancelled; seconds after the launch."""

    name: str
    kind: str
    deadline_s: float
    cancelled_s: float | None

    @property
    def ends_s(self) -> float:
        """From when on nothing of it is to be done."""
        cancelled_s = self.deadline_s if self.cancelled_s is None else self.cancelled_s
        return min(self.deadline_s, cancelled_s)


def account(
    jobs: Iterable[Submitted], events: Iterable[Mapping[str, Any]]
) -> tuple[Counter[str], list[str]]:
    """How many jobs were done, expired or cancelled; and the rules that were broken."""
    of_job: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for event in events:
        of_job[parse_activation(event["activation"]).job].append(event)
    counts: Counter[str] = Counter()
    broken: list[str] = []
    for job in jobs:
        done = Counter(e["local_task"] for e in of_job[job.name] if e["outcome"] == "success")
        is_done = sorted(done) == sorted(TASKS[job.kind])
        late = [e for e in of_job[job.name] if e["t"] > job.ends_s + SLACK_S]
        if is_done:
            state = "done"
        elif job.cancelled_s is not None and job.cancelled_s <= job.deadline_s:
            state = "cancelled"
        else:
            state = "expired"
        counts[state] += 1
        if max(done.values(), default=0) > 1:
            broken.append(f"{job.name} was done twice: {dict(done)}")
        broken += [f"{job.name}: {e['local_task']} {e['event']} {e['t']}, late" for e in late]
    return counts, broken


async def _work(task: TaskContext, *_: str) -> None:
    await anyio.sleep(task.simulation.duration_s)


def drawn(count: int, seconds: float, seed: int) -> tuple[list[Submitted], list[tuple[int, Fault]]]:
    """Jobs, and the schedule that hands them in and kills robots."""
    pick = random.Random(seed)
    steps: list[tuple[float, Fault]] = []
    down: dict[str, list[tuple[float, float]]] = defaultdict(list)
    robots = ["A1", "A2", "A3", "A4", "B1", "B2"]
    at_s = BEGIN_S
    while (at_s := at_s + pick.uniform(15, 40)) < seconds:
        robot, back_s = pick.choice(robots), at_s + pick.uniform(5, 25)
        steps += [(at_s, Kill(robot)), (back_s, Restart(robot))]
        down[robot].append((at_s - 2, back_s + 5))
        if pick.random() < 0.3:
            ahead_us = pick.choice([-1, 1]) * pick.randint(2, 3_600) * US
            steps += [(at_s, SetWallClock("B2", ahead_us)), (back_s, SetWallClock("B2", 0))]

    def up(at_s: float) -> list[str]:
        return [r for r in robots if not any(a <= at_s <= b for a, b in down[r])]

    bursts = [pick.uniform(BEGIN_S, seconds) for _ in range(1 + count // 60)]
    jobs = []
    for number in range(count):
        at_s = pick.uniform(BEGIN_S, seconds)
        if pick.random() < 0.4:
            at_s = pick.choice(bursts) + pick.random()
        kind, name = pick.choice(sorted(TASKS)), f"job-{number}"
        job = Submitted(
            name,
            kind,
            at_s + pick.uniform(120, 600),
            at_s + pick.uniform(1, 300) if pick.random() < 0.1 else None,
        )
        deadline_us = LAUNCH_UNIX_US + round(job.deadline_s * US)
        value = [kind, [str(pick.randint(1, 9))], 0, 0, deadline_us, number]
        steps.append((at_s, Operate(pick.choice(up(at_s)), f"job/{name}", value, "me")))
        if job.cancelled_s is not None:
            first, *others = up(job.cancelled_s)
            cancel = Operate(first, f"job_cancelled/{name}", True, "me", tuple(others))
            steps.append((job.cancelled_s, cancel))
        jobs.append(job)
    return jobs, [(round(at_s * US), fault) for at_s, fault in steps]


def run(count: int = 600, seconds: float = 3_600, seed: int = 1) -> dict[str, Any]:
    """Hand in `count` jobs over a span of virtual seconds."""
    mission, program = mission_from_yaml(MISSION, __file__, Path()), RobotProgram(record_work=True)
    for name in mission.local_tasks:
        program.local_task(name)(_work)
    jobs, schedule = drawn(count, seconds, seed)
    result = simulate(
        mission,
        program,
        seed=seed,
        schedule=schedule,
        timeout_us=round((seconds + 640) * US),
        inspect=False,
    )
    events = [{**event, "t": float(event["t"])} for event in result.events]
    counts, broken = account(jobs, events)
    known = result.observer.facts.jobs
    assert known is not None
    begun = {(e["robot"], e["activation"]) for e in events if e["event"] == "start"}
    ended = {(e["robot"], e["activation"]) for e in events if e["event"] != "start"}
    figures = {"seed": seed, "jobs": count, "broken": broken, "open_at_the_end": known.count_open()}
    return figures | {"died_at_work": len(begun - ended), **counts}


if __name__ == "__main__":
    found = run_program(__doc__, run)
    raise SystemExit(1 if found["broken"] or found["open_at_the_end"] else 0)
