"""Whatever robots compute with, a run is the same, effect for effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.engine import DEFINITIONS, FASTEST
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.make_plan import PlanFunction
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.sim import SimulationResult
from mrbt_mesh.sim.run import SimulationError, run_scenario
from tests.support.compared_plans import compared
from tests.support.effort import at_size
from tests.support.runs import source

# The first are quick ones, with all kinds of nodes, tasks and faults between them.
SEEDS = (1, 3, 9, 12, 220, 224, 231, 238, *range(100, 120))
EXAMPLES = (
    *("assembly", "couriers", "dispense", "explore", "inspection", "lift"),
    *("tool_search", "vehicle_repair"),
)


def runs(name: str | None, seed: int) -> list[SimulationResult]:
    """One chaos run with each engine."""
    mission, program = source(name).load(seed)
    scenario = source(name).scenario(seed, mission)
    engines = (FASTEST, DEFINITIONS)
    return [run_scenario(mission, program, scenario, engine=engine) for engine in engines]


@pytest.mark.slow
@pytest.mark.parametrize("seed", at_size(quick=SEEDS[:1], gate=SEEDS))
def test_on_generated_missions(seed: int) -> None:
    _are_one(runs(None, seed))


@pytest.mark.slow
@pytest.mark.parametrize("name", at_size(quick=EXAMPLES[1:3], gate=EXAMPLES))
def test_on_the_examples(name: str) -> None:
    _are_one(runs(name, 2))


def _are_one(results: list[SimulationResult]) -> None:
    assert [result.violations for result in results] == [[], []]
    assert len({result.effect_log_digest for result in results}) == 1
    assert results[0].effect_log_digest


def test_a_plan_that_is_not_that_of_the_definitions_breaks_a_run() -> None:
    def wrong(solver: Solver) -> PlanFunction:
        make_plan = DEFINITIONS.plan_making(solver)

        def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
            made = make_plan(facts, alive)
            return replace(made, consistent=not made.consistent)

        return plan

    engine = compared(replace(FASTEST, plan_making=wrong))
    mission, program = source("explore").load(2)
    scenario = source("explore").scenario(2, mission)
    with pytest.raises((AssertionError, SimulationError), match="not that of the definitions"):
        run_scenario(mission, program, scenario, engine=engine)
