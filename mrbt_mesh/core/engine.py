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
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.steps import PlanningSteps

# What evaluates T_G over these facts, which may change from one evaluation to the next.
MakeEvaluator: TypeAlias = Callable[[TeamFacts], Evaluator]
PlanFunction: TypeAlias = Callable[[TeamFacts, Mapping[str, Incarnation]], Plan]
# What makes the plans of one robot, with an evaluator of its facts.
PlanMaking: TypeAlias = Callable[[Mission, Evaluator, Solver], PlanFunction]

# Teams for which a plan is made faster by the definitions than by keeping what has not changed.
SMALL_TEAM, SMALL_TREE = 8, 200


def plain_evaluator(facts: TeamFacts) -> Evaluator:
    """The definition."""
    return Evaluator(facts.mission.tree)


def incremental_evaluator(facts: TeamFacts) -> Evaluator:
    """Looks again only at what changed facts can influence."""
    return IncrementalEvaluator(facts.mission.tree, facts)


def plain_plans(mission: Mission, evaluator: Evaluator, solver: Solver) -> PlanFunction:
    """Each plan from scratch, by the definitions."""
    return _plans(mission, PlanningSteps(evaluator, solver))


def incremental_plans(mission: Mission, evaluator: Evaluator, solver: Solver) -> PlanFunction:
    """Plans that follow one another: each uses what has not changed since the one before."""
    return _plans(mission, IncrementalSteps(evaluator, solver))


def fastest_plans(mission: Mission, evaluator: Evaluator, solver: Solver) -> PlanFunction:
    """Whichever is faster for a team of this size."""
    is_small = len(mission.robots) <= SMALL_TEAM and len(mission.tree.nodes) <= SMALL_TREE
    return (plain_plans if is_small else incremental_plans)(mission, evaluator, solver)


def _plans(mission: Mission, steps: PlanningSteps) -> PlanFunction:
    def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        return make_plan(mission, facts, alive, steps)

    return plan


@dataclass(frozen=True)
class Engine:
    """What an agent or an observer computes with."""

    evaluator: MakeEvaluator = incremental_evaluator
    plan_making: PlanMaking = fastest_plans
    write_heartbeat: WriteHeartbeat = write_heartbeat
    read_heartbeat: ReadHeartbeat = read_heartbeat
    read_batch: ReadBatch = read_batch


# What robots use.
FASTEST = Engine()
# Nothing by its definition that there is a faster way for, however small the team.
INCREMENTAL = Engine(plan_making=incremental_plans)
# Everything by its definition.
DEFINITIONS = Engine(plain_evaluator, plain_plans)
