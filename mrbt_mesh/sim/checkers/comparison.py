"""I7: what only makes plans faster changes nothing of them, compared at every plan of a run.

Beside each robot's own planner stand the definitions, from scratch, and an incremental planner
that follows the same facts. Whatever the robot computes with, it has to come to the same plan.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.engine import DEFINITIONS, INCREMENTAL, Engine, PlanFunction
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.sim.checkers.findings import RunFindings

# Robots come to the same facts at about the same time.
RECENT = 256


class PlanComparison:
    """Gives robots an engine that makes every plan again, in the other ways.

    `engine` is that engine. `findings` notes where two plans differ; it must be there before the
    first one is made. `compared` counts.
    """

    findings: RunFindings

    def __init__(self, engine: Engine) -> None:
        self.compared = 0
        self.engine = replace(engine, plan_making=self._plan_making)
        self._chosen = engine
        self._by_definition: dict[tuple[bytes, frozenset[tuple[str, Incarnation]]], Plan] = {}

    def _plan_making(self, mission: Mission, evaluator: Evaluator, solver: Solver) -> PlanFunction:
        make_plan = self._chosen.plan_making(mission, evaluator, solver)
        others: dict[str, PlanFunction] = {}
        if self._chosen.plan_making is not DEFINITIONS.plan_making:
            others["that of the definitions"] = self._defined
        if self._chosen.plan_making is not INCREMENTAL.plan_making:
            others["what an incremental planner makes"] = _follower()

        def make_and_compare(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
            plan = make_plan(facts, alive)
            for name, make_again in others.items():
                self._compare(plan, make_again(facts, alive), name)
            return plan

        return make_and_compare

    def _defined(self, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        """The plan by the definitions; made once for robots that know the same."""
        key = (facts.map.digest(), frozenset(alive.items()))
        plan = self._by_definition.get(key)
        if plan is None:
            if len(self._by_definition) >= RECENT:
                self._by_definition.clear()
            plan = self._by_definition[key] = _planner(DEFINITIONS, facts)(facts, alive)
        return plan

    def _compare(self, plan: Plan, other: Plan, name: str) -> None:
        """Every field must be equal, also those of the evaluation, and every byte."""
        self.compared += 1
        if plan != other or plan.packed != other.packed:
            mine, others = plan.to_json(), other.to_json()
            parts = [part for part in mine if json.dumps(mine[part]) != json.dumps(others[part])]
            parts = parts or ["evaluation"]  # what is not shown of it
            self.findings.say("I7", f"a plan is not {name}: {', '.join(parts)}")


def _planner(engine: Engine, facts: TeamFacts) -> PlanFunction:
    return engine.plan_making(facts.mission, engine.evaluator(facts), default_solver)


def _follower() -> PlanFunction:
    """Plans incrementally, for whoever calls it with the same facts again and again."""
    followed: TeamFacts | None = None
    make_plan: PlanFunction

    def follow(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        nonlocal followed, make_plan
        if facts is not followed:
            followed, make_plan = facts, _planner(INCREMENTAL, facts)
        return make_plan(facts, alive)

    return follow
