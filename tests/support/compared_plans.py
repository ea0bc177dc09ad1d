"""An engine that makes each plan by the definitions as well, and accepts no difference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import count

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.engine import DEFINITIONS, Engine
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.make_plan import PlanFunction
from mrbt_mesh.core.planning.plan import Plan


def compared(engine: Engine, every: int = 1) -> Engine:
    """The same engine; a plan of it that differs from the plain one is an AssertionError.

    Of each robot's plans the first and then every `every`-th are compared: what is kept from one to
    the next, and is wrong, is so in the later ones as well.
    """

    def plan_making(solver: Solver) -> PlanFunction:
        make_plan, make_plain = engine.plan_making(solver), DEFINITIONS.plan_making(solver)
        numbers = count()

        def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
            made = make_plan(facts, alive)
            if next(numbers) % every:
                return made
            plain = make_plain(facts, alive)
            text = "a plan is not that of the definitions"
            assert (made, made.packed) == (plain, plain.packed), text
            return made

        return plan

    return replace(engine, plan_making=plan_making)
