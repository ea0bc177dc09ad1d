"""How an agent or an observer works out its plans and reads messages: one bundle, passed in.

This is the one place that knows of `incremental`. Taken out, everything runs on the definitions,
with the same results: `DEFINITIONS`.

Several agents in one process, as in the simulator, read the same messages and make the same plans:
they may share functions that remember their answers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.incremental.evaluation.evaluator import IncrementalEvaluator
from mrbt_mesh.core.incremental.planning.steps import IncrementalSteps
from mrbt_mesh.core.membership.wire import (
    ReadBatch,
    ReadHeartbeat,
    WriteHeartbeat,
    read_batch,
    read_heartbeat,
    write_heartbeat,
)
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.steps import PlanningSteps

# What evaluates T_G over these facts, which may change from one evaluation to the next.
MakeEvaluator: TypeAlias = Callable[[TeamFacts], Evaluator]
PlanFunction: TypeAlias = Callable[[TeamFacts, Mapping[str, Incarnation]], Plan]
# What makes one robot's plans.
PlanMaking: TypeAlias = Callable[[Evaluator, Solver], PlanFunction]


def plain_evaluator(facts: TeamFacts) -> Evaluator:
    """The definition."""
    return Evaluator(facts.mission.tree)


def incremental_evaluator(facts: TeamFacts) -> Evaluator:
    """Looks again only at what changed facts can influence."""
    return IncrementalEvaluator(facts.mission.tree, facts)


def plain_plans(evaluator: Evaluator, solver: Solver) -> PlanFunction:
    """Each plan from scratch, by the definitions."""
    return _plans(PlanningSteps(evaluator, solver))


def incremental_plans(evaluator: Evaluator, solver: Solver) -> PlanFunction:
    """Plans that follow one another: each uses what has not changed since the one before."""
    return _plans(IncrementalSteps(evaluator, solver))


def _plans(steps: PlanningSteps) -> PlanFunction:
    def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        return make_plan(facts.mission, facts, alive, steps)

    return plan


@dataclass(frozen=True)
class Engine:
    """What an agent or an observer computes with."""

    evaluator: MakeEvaluator = incremental_evaluator
    plan_making: PlanMaking = incremental_plans
    write_heartbeat: WriteHeartbeat = write_heartbeat
    read_heartbeat: ReadHeartbeat = read_heartbeat
    read_batch: ReadBatch = read_batch


# What robots use.
INCREMENTAL = Engine()
# Everything by its definition.
DEFINITIONS = Engine(plain_evaluator, plain_plans)
