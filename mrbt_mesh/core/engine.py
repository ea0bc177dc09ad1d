"""How an agent or an observer makes plans and reads messages: one bundle, passed in.

Several agents in one process, as in the simulator, read the same messages and make the same plans:
they may share functions that remember their answers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.wire import (
    ReadBatch,
    ReadHeartbeat,
    WriteHeartbeat,
    read_batch,
    read_heartbeat,
    write_heartbeat,
)
from mrbt_mesh.core.planning.capabilities import Capabilities, capabilities_of
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan

PlanFunction: TypeAlias = Callable[[TeamFacts, Mapping[str, Incarnation]], Plan]
# What makes the plans of one robot.
PlanMaking: TypeAlias = Callable[[Solver], PlanFunction]


def plain_plans(solver: Solver) -> PlanFunction:
    """Each plan from its facts alone."""

    def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        return make_plan(facts, alive, solver)

    return plan


def quick_plans(solver: Solver) -> PlanFunction:
    """The same plans: what robots can do is looked up for those alone that differ."""
    known: Capabilities | None = None

    def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        nonlocal known
        known = capabilities = capabilities_of(facts, alive, known)
        return make_plan(facts, alive, solver, capabilities)

    return plan


@dataclass(frozen=True)
class Engine:
    """What an agent or an observer computes with."""

    plan_making: PlanMaking = quick_plans
    write_heartbeat: WriteHeartbeat = write_heartbeat
    read_heartbeat: ReadHeartbeat = read_heartbeat
    read_batch: ReadBatch = read_batch


# What robots use.
FASTEST = Engine()
# Nothing is kept from one plan to the next.
DEFINITIONS = Engine(plain_plans)
