"""Many open jobs: what a plan costs after one more has arrived, and what is left when all ended.

    python -m benchmarks.open_jobs [--few 100] [--many 10000] [--robots 100] [--json FILE]

The facts of one robot, in a team of which every robot works on a job. `plan_us`: the least of
several times, of CPU time, from an arrival to the next plan. `facts`: entries of the map, with all
jobs open and after all have ended, when only the newest ends and archives are kept. The exit status
is 1 if a plan with many open jobs takes more than 3 times that with few, or facts remain.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from benchmarks.report import run_program
from mrbt_mesh.core.agent.operator_messages import command_version
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts import jobs, records
from mrbt_mesh.core.facts.records import Claim, JobEnd, JobState, Member, Phase, Record
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.planning.make_plan import quick_plans
from mrbt_mesh.formats.build import mission_from_yaml

MISSION = """
mission: open_jobs
ends: never
local_tasks: {take: {parameters: [shelf]}, put: {parameters: [shelf]}}
robot_types: {cart: {capabilities: {take: 1, put: 1}}}
global_tasks:
  fetch: {parameters: [shelf], needs: {take($shelf): {}}}
  bring: {parameters: [shelf], needs: {put($shelf): {}}}
jobs:
  bring:
    parameters: {shelf: {min: 1, max: 99}}
    tree: {Sequence: [fetch($shelf), bring($shelf)]}
tree: {Jobs: all}
"""
LIFE = Incarnation(1, "n")
ARRIVALS = 40
MOST = 3.0


class Desk:
    """The facts of a team at work, and what its robots write."""

    def __init__(self, robots: int, open_jobs: int) -> None:
        names = ", ".join(f"R{number}: cart" for number in range(robots))
        text = f"{MISSION}robots: {{{names}}}\n"
        self.mission = mission_from_yaml(text, "open_jobs", Path())
        self.facts = TeamFacts(self.mission, "r")
        self.alive = dict.fromkeys(sorted(self.mission.robots), LIFE)
        self._plan = quick_plans(default_solver)
        self._written = 0
        self.jobs = 0
        for robot in self.mission.robots.values():
            member = Member("cart", robot.capabilities, {}, False, "", "", 0)
            self.write(robot.id, records.MEMBER, member)
        for _ in range(open_jobs):
            self.submit()
        for assignment in self.plan().assignments.values():
            names_of = assignment.activation, assignment.global_task, assignment.local_task
            self.write(assignment.robot, records.CLAIM, Claim(*names_of, Phase.RUNNING, 1))
        self.plan()

    def write(self, robot: str, name: str, record: Record) -> None:
        self._written += 1
        version = Version(LIFE, self._written)
        self.facts.map.merge([parse_entry(robot, name, version, record.to_value())])

    def submit(self, priority: int = 0) -> None:
        self.jobs += 1
        value = ["bring", [str(1 + self.jobs % 99)], priority, 0, 0, 0]
        name, version = f"{records.JOB}/job-{self.jobs}", command_version(self.jobs, "c")
        self.facts.map.merge([make_command(name, value, "me", version, "r", None)])

    def plan(self) -> Any:
        self.facts.prune()
        self.facts.turned_guards()
        return self._plan(self.facts, self.alive)

    def plan_us(self) -> float:
        """From the arrival of an urgent job, which goes first in the tree, to the next plan."""
        times = []
        for _ in range(ARRIVALS):
            started_s = time.process_time()
            self.submit(priority=9)
            self.plan()
            times.append(time.process_time() - started_s)
        return min(times) * 1e6

    def end_all(self) -> None:
        """All jobs end, one after the other, and are archived as robots do it."""
        for number in range(1, self.jobs + 1):
            end = JobEnd(JobState.SUCCEEDED, "bring", ("1",), "me", "", ("R1",), number)
            for robot in sorted(self.alive)[: jobs.WITNESSES]:
                self.write(robot, f"{records.JOB_END}/job-{number}", end)
            assert self.facts.jobs is not None
            if (archive := self.facts.jobs.to_archive(0)) is not None:
                self.write("R1", f"{records.JOB_ARCHIVE}/{archive[0]}", archive[1])
            self.facts.prune()


def run(few: int = 100, many: int = 10_000, robots: int = 100) -> dict[str, Any]:
    """With `few` and with `many` open jobs."""
    found: dict[str, Any] = {}
    for name, count in (("few", few), ("many", many)):
        desk = Desk(robots, count)
        plan_us = desk.plan_us()
        opened = len(desk.facts.map)
        desk.end_all()
        left = len(desk.facts.map)
        found[name] = {"jobs": count, "plan_us": round(plan_us), "facts": [opened, left]}
    ends = jobs.WITNESSES * (jobs.KEPT_ENDS + 2 * records.MAX_ARCHIVED)
    kept = robots * 2 + ends + jobs.KEPT_ARCHIVES
    found["plan_ratio"] = round(found["many"]["plan_us"] / found["few"]["plan_us"], 2)
    found["shrinks"] = found["many"]["facts"][1] <= kept
    return found


if __name__ == "__main__":
    figures = run_program(__doc__, run)
    raise SystemExit(1 if figures["plan_ratio"] > MOST or not figures["shrinks"] else 0)
