"""I7: what a robot keeps from one plan to the next changes nothing of its plans.

Each plan of a robot is made again by the definition, from the facts alone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.engine import DEFINITIONS, Engine
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.make_plan import PlanFunction, make_plan
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.sim.checkers.findings import RunFindings
from mrbt_mesh.sim.world.sharing import Recent


class PlanComparison:
    """Gives robots an engine that makes every plan again by the definition.

    `engine` is that engine. `run` notes differences; it is set before the first plan is made.
    `compared` counts plans.
    """

    run: RunFindings

    def __init__(self, engine: Engine) -> None:
        self.compared = 0
        self.engine = replace(engine, plan_making=self._plan_making)
        self._chosen = engine
        self._by_definition = Recent[tuple[bytes, frozenset[tuple[str, Incarnation]]], Plan]()

    def _plan_making(self, solver: Solver) -> PlanFunction:
        make_plan = self._chosen.plan_making(solver)

        def make_and_compare(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
            plan = make_plan(facts, alive)
            if self._chosen.plan_making is not DEFINITIONS.plan_making:
                self._compare(plan, self._defined(facts, alive))
            return plan

        return make_and_compare

    def _defined(self, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        """The plan by the definitions; made once for robots that know the same."""
        key = (facts.map.digest(), frozenset(alive.items()))
        plan = self._by_definition.get(key)
        if plan is None:
            plan = self._by_definition[key] = make_plan(facts, alive, default_solver)
        return plan

    def _compare(self, plan: Plan, other: Plan) -> None:
        """Every field must be equal, also those of the evaluation, and every byte."""
        self.compared += 1
        if plan != other or plan.packed != other.packed:
            mine, others = plan.to_json(), other.to_json()
            parts = [part for part in mine if json.dumps(mine[part]) != json.dumps(others[part])]
            parts = parts or ["evaluation"]  # what is not shown of it
            self.run.violation("I7", f"a plan is not that of the definitions: {', '.join(parts)}")
