"""The plan: who does what and why. A pure function that every robot computes for the whole team.

    plan(evaluator, facts, alive) -> Plan

Same facts and same alive set give the same bytes on every robot.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import msgpack

from mrbt_mesh.core.assignment import UNASSIGNED, AssignmentProblem, Bounds, Solver
from mrbt_mesh.core.canonical import solve
from mrbt_mesh.core.coalition import standing
from mrbt_mesh.core.demand import (
    Demand,
    Shortage,
    Worker,
    demands_of,
    kept_requests,
    lives,
    obstacle,
    shortages,
    workers,
)
from mrbt_mesh.core.evaluate import Evaluation, Evaluator
from mrbt_mesh.core.facts import Incarnation
from mrbt_mesh.core.mission import Assignment
from mrbt_mesh.core.records import OrderKind
from mrbt_mesh.core.scarcity import spare_scarce
from mrbt_mesh.core.team import TeamFacts
from mrbt_mesh.core.tree import Status


@dataclass(frozen=True, slots=True)
class Line:
    """One robot's line of the plan. `pinned`: it was running this already and goes on.

    `leader` brings the coalition together, where the task is carried out by one; `round`
    counts the coalitions that have ended without success.
    """

    robot: str
    activation: str
    global_task: str
    local_task: str
    performance: int
    pinned: bool
    leader: str = ""
    round: int = 0


@dataclass(frozen=True, slots=True)
class Waiting:
    """A request that is not served. With `shortages` it is blocked: no living robots could.

    `obstacle` is what keeps an exclusive task from being served, whoever is there.
    """

    activation: str
    global_task: str
    shortages: tuple[Shortage, ...]
    obstacle: str = ""

    @property
    def is_blocked(self) -> bool:
        """Whether it waits for more than for busy robots."""
        return bool(self.shortages or self.obstacle)

    @property
    def reason(self) -> str:
        """For people: `blocked: move_frame needs 2, 1 alive`."""
        if self.obstacle:
            return f"blocked: {self.obstacle}"
        if not self.shortages:
            return "waiting: the robots it needs are busy with earlier requests"
        return "blocked: " + "; ".join(map(str, self.shortages))


@dataclass(frozen=True)
class Plan:
    """`lines` by robot; `idle` says why a robot has none; `waiting` in tree order.

    `feasible` is what *Assign Agents* returns: whether the assignment problem had a solution.
    """

    evaluation: Evaluation
    order: OrderKind
    lines: Mapping[str, Line]
    idle: Mapping[str, str]
    waiting: tuple[Waiting, ...]
    feasible: bool

    @cached_property
    def result(self) -> Status:
        """The mission's status: T_G's, or FAILURE once the operator has aborted."""
        return Status.FAILURE if self.order is OrderKind.ABORT else self.evaluation.status

    @cached_property
    def digest(self) -> bytes:
        """8 bytes over activation -> robots alone: no phases, no pins, not the alive set."""
        lines = sorted((x.activation, x.local_task, x.robot, x.round) for x in self.lines.values())
        return hashlib.blake2b(msgpack.packb(lines), digest_size=8).digest()

    @cached_property
    def packed(self) -> bytes:
        """The whole plan as bytes; equal on all robots with the same facts and alive set."""
        return bytes(msgpack.packb(self.to_json()))

    def partners(self, robot: str) -> tuple[str, ...]:
        """The other robots on the same local task of the same activation."""
        line = self.lines[robot]
        key = (line.activation, line.local_task)
        return tuple(
            x.robot
            for x in self.lines.values()
            if (x.activation, x.local_task) == key and x.robot != robot
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data, in a fixed order."""
        return {
            "result": self.result.name.lower(),
            "order": str(self.order),
            "feasible": self.feasible,
            "statuses": [int(status) for status in self.evaluation.statuses],
            "requests": [[r.subject, r.activation] for r in self.evaluation.requests],
            "lines": {
                x.robot: {
                    "activation": x.activation,
                    "global_task": x.global_task,
                    "local_task": x.local_task,
                    "performance": x.performance / 1e6,
                    "pinned": x.pinned,
                    "leader": x.leader or None,
                    "round": x.round,
                }
                for x in self.lines.values()
            },
            "idle": dict(self.idle),
            "waiting": [
                {
                    "activation": w.activation,
                    "global_task": w.global_task,
                    "blocked": w.is_blocked,
                    "reason": w.reason,
                }
                for w in self.waiting
            ],
        }


def make_plan(
    evaluator: Evaluator, facts: TeamFacts, alive: Mapping[str, Incarnation], solver: Solver
) -> Plan:
    """Evaluate T_G, check consistency, assign robots."""
    evaluation = evaluator.evaluate(facts)
    order = facts.order()
    team = workers(facts, alive)
    away = {robot: "leaving" for robot in sorted(alive) if robot not in team}
    if order is not OrderKind.RESUME:
        idle = dict.fromkeys(team, f"the operator's order is {order}")
        return Plan(evaluation, order, {}, idle | away, (), True)
    demands = demands_of(facts, evaluation.requests, team)
    obstacles = [
        obstacle(facts, request, group, team)
        for request, group in zip(evaluation.requests, demands, strict=True)
    ]
    barred = [index for index, text in enumerate(obstacles) if text]
    offered: Sequence[Sequence[Demand]] = demands
    if facts.mission.assignment is Assignment.SPARE_SCARCE:
        offered = spare_scarce(facts, evaluation, demands, team)
    kept, pinned = kept_requests(facts, offered, team, barred)
    lines = _pinned_lines(offered, pinned)
    chosen = _assign([d for i in kept for d in offered[i]], team, lines, solver)
    if chosen is not None:
        lines.update(chosen)
    waiting = tuple(
        Waiting(
            r.activation,
            r.subject,
            () if obstacles[index] else shortages(facts, demands[index], team),
            obstacles[index],
        )
        for index, r in enumerate(evaluation.requests)
        if index not in kept
    )
    idle = {
        r: _why_idle(w, demands, offered, kept, lines) for r, w in team.items() if r not in lines
    }
    ordered = _with_leaders(facts, {robot: lines[robot] for robot in sorted(lines)}, team)
    return Plan(evaluation, order, ordered, idle | away, waiting, chosen is not None)


def _line(robot: str, demand: Demand, pinned: bool) -> Line:
    request = demand.request
    performance = demand.candidates[robot]
    return Line(robot, request.activation, request.subject, demand.local_task, performance, pinned)


def _with_leaders(
    facts: TeamFacts, lines: Mapping[str, Line], team: Mapping[str, Worker]
) -> dict[str, Line]:
    """Name the leader where a task is carried out by a coalition: that of the standing one,
    else the first robot that the plan has on the activation.
    """
    leaders: dict[str, tuple[str, int]] = {}
    result = {}
    for robot, line in lines.items():
        task = facts.mission.global_tasks[line.global_task]
        if task.by_coalition:
            if line.activation not in leaders:
                token = standing(facts, task, line.activation, lives(team))
                number = facts.coalitions(line.activation).round(facts.givers, token)
                leaders[line.activation] = (token.leader if token is not None else robot, number)
            leader, number = leaders[line.activation]
            line = replace(line, leader=leader, round=number)
        result[robot] = line
    return result


def _pinned_lines(
    demands: Sequence[Sequence[Demand]], pinned: Mapping[str, int]
) -> dict[str, Line]:
    lines = {}
    for index, group in enumerate(demands):
        for demand in group:
            for robot in demand.pinned:
                if pinned.get(robot) == index:
                    lines[robot] = _line(robot, demand, True)
    return lines


def _assign(
    demands: Sequence[Demand],
    team: Mapping[str, Worker],
    pinned: Mapping[str, Line],
    solver: Solver,
) -> dict[str, Line] | None:
    """Put the robots that are not pinned on what the kept demands still want; None: infeasible."""
    robots = tuple(robot for robot in team if robot not in pinned)
    bounds, open_demands = [], []
    for demand in demands:
        held = sum(
            1
            for robot in demand.pinned
            if robot in pinned and pinned[robot].activation == demand.request.activation
        )
        if demand.upper > held:
            key = f"{demand.request.activation}/{demand.local_task}"
            bounds.append(Bounds(key, max(0, demand.lower - held), demand.upper - held))
            open_demands.append(demand)
    performance = tuple(
        {i: d.candidates[robot] for i, d in enumerate(open_demands) if robot in d.candidates}
        for robot in robots
    )
    choice = solve(AssignmentProblem.of(robots, bounds, performance), solver)
    if choice is None:
        return None
    return {
        robot: _line(robot, open_demands[index], False)
        for robot, index in zip(robots, choice, strict=True)
        if index != UNASSIGNED
    }


def _why_idle(
    worker: Worker,
    demands: Sequence[Sequence[Demand]],
    offered: Sequence[Sequence[Demand]],
    kept: Sequence[int],
    lines: Mapping[str, Line],
) -> str:
    able = [i for i, group in enumerate(demands) for d in group if worker.id in d.candidates]
    if not demands:
        return "nothing is requested"
    if not able:
        return "no request needs what it can do"
    if not any(worker.id in d.candidates for group in offered for d in group):
        names = sorted({demands[index][0].request.subject for index in able})
        return f"{', '.join(names)}: spared for what fewer robots can do"
    served = [index for index in able if index in kept]
    if served:
        names = sorted({demands[index][0].request.subject for index in served})
        return f"{', '.join(names)}: as many robots as are allowed or useful"
    names = sorted({demands[index][0].request.subject for index in able})
    return f"{', '.join(names)}: waits for robots"
