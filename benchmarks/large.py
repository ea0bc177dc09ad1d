"""Large missions in progress, with their facts, for the benchmarks of planning.

The tree is a Parallel of jobs. Each has ten nodes: it is carried out once it is ready, is skipped
where it is done, and then has two more actions, one of which is tried again. Every job has local
tasks of its own that ten robots can do.
"""

from __future__ import annotations

import random
from typing import Any

from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, build_tree
from mrbt_mesh.core.engine import FASTEST
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Claim, Member, Phase
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import (
    MICRO,
    GlobalTask,
    LocalTask,
    Mission,
    Need,
    Robot,
)
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan, RobotAssignment

NODES_PER_JOB = 10
RUN = "benchmark"


def large_mission(robots: int, nodes: int, capable: int = 10, seed: int = 0) -> Mission:
    """That many robots, and about that many nodes; nu 1 to 3, mu nu to 5, performance 1 to 1000."""
    draw = random.Random(f"{seed}/{robots}/{nodes}")
    jobs = range(max(1, nodes // NODES_PER_JOB))
    team: list[dict[str, int]] = [{} for _ in range(robots)]
    tasks: dict[str, GlobalTask] = {}
    for job in jobs:
        able = draw.sample(range(robots), min(capable, robots))
        for robot in able:
            team[robot][f"work{job}"] = draw.randint(1, 1000) * MICRO
        for step in "abcd":
            least = draw.randint(1, 3)
            need = Need(f"work{job}", least, draw.randint(least, 5))
            tasks[f"{step}{job}"] = GlobalTask(f"{step}{job}", (need,))
    names = [f"R{robot:04}" for robot in range(robots)]
    conditions = [f"{name}{job}" for job in jobs for name in ("ready", "done")]
    tree = NodeSpec(Kind.PARALLEL, tuple(map(_job, jobs)), limit=len(jobs))
    return Mission(
        name="large",
        robots={name: Robot(name, "T", can) for name, can in zip(names, team, strict=True)},
        robot_types={"T": {}},
        local_tasks={f"work{job}": LocalTask(f"work{job}") for job in jobs},
        conditions={name: ConditionType(name, default=name[0] == "r") for name in conditions},
        global_tasks=tasks,
        tree=build_tree(tree),
    )


def _job(job: int) -> NodeSpec:
    def leaf(kind: Kind, name: str) -> NodeSpec:
        return NodeSpec(kind, subject=f"{name}{job}")

    first = NodeSpec(Kind.SEQUENCE, (leaf(Kind.ACTION, "a"), leaf(Kind.ACTION, "b")))
    unless = NodeSpec(Kind.FALLBACK, (leaf(Kind.CONDITION, "done"), first))
    again = NodeSpec(Kind.RETRY, (leaf(Kind.ACTION, "d"),), limit=3)
    ready = leaf(Kind.CONDITION, "ready")
    return NodeSpec(Kind.SEQUENCE, (ready, unless, leaf(Kind.ACTION, "c"), again))


class WrittenFacts:
    """The facts of a team, as its robots write them: each call is a batch, which it returns."""

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.facts = TeamFacts(mission, RUN)
        self.lives = dict.fromkeys(mission.robots, 1)
        self.sequence = 0

    def write(self, robot: str, *values: tuple[str, Any]) -> list[Entry]:
        self.sequence += 1
        version = Version(Incarnation(self.lives[robot], "n"), self.sequence)
        entries = [parse_entry(robot, name, version, value) for name, value in values]
        self.facts.map.merge(entries)
        return entries

    def join(self, robot: str) -> list[Entry]:
        """A robot describes itself, and that it has nothing to do."""
        member = Member("T", self.mission.robots[robot].capabilities, {}, False, "", "", 0)
        return self.write(robot, (records.MEMBER, member.to_value()), (records.CLAIM, None))

    def begin(self, line: RobotAssignment) -> list[Entry]:
        """A robot begins its assignment, or confirms it."""
        task = parse_activation(line.activation).subject
        claim = Claim(line.activation, task, line.local_task, Phase.RUNNING, 1)
        return self.write(line.robot, (records.CLAIM, claim.to_value()))

    def finish(self, line: RobotAssignment) -> list[Entry]:
        """A robot succeeds with its assignment."""
        outcome = (f"{records.OUTCOME}/{line.activation}/{line.local_task}", [True, None])
        return self.write(line.robot, outcome, (records.CLAIM, None))

    def turn(self, name: str, robot: str) -> list[Entry]:
        """A robot sees a condition change."""
        facts = self.facts
        row = [not facts.condition(name), facts.conditions.changes(name) + 1, facts.max_stamp + 1]
        return self.write(robot, (f"{records.CONDITION}/{name}", row))


class LargeTeam(WrittenFacts):
    """A team at work on a mission, and its plans."""

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission)
        self.alive = dict.fromkeys(mission.robots, Incarnation(1, "n"))
        self._plan = FASTEST.plan_making(default_solver)
        for robot in mission.robots:
            self.join(robot)

    def plan(self) -> Plan:
        """The next plan."""
        self.facts.prune()
        return self._plan(self.facts, self.alive)

    def plan_anew(self) -> Plan:
        """The same plan by the definition."""
        return make_plan(self.facts, self.alive, default_solver)

    def start(self, plan: Plan) -> None:
        """Every robot begins its assignment."""
        for line in plan.assignments.values():
            if not line.pinned:
                self.begin(line)
