"""Every plan of a run is held against what the other ways to plan make of the same facts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import pytest

from mrbt_mesh.core.agent.inputs import ConditionSet
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.evaluation import RunningTimeout
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.engine import DEFINITIONS, FASTEST, Engine
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.make_plan import PlanFunction
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.sim import AgentOptions, simulate
from mrbt_mesh.sim.checkers.comparison import PlanComparison
from tests.support.checked_team import Team
from tests.support.runs import example

SECOND_US = 1_000_000


def violations(engine: Engine) -> list[str]:
    """What is found in a few seconds of a mission, without times."""
    mission, program = example("vehicle_repair")
    agents = AgentOptions(engine=engine)
    result = simulate(mission, program, seed=1, agents=agents, timeout_us=4 * SECOND_US)
    return [text.partition(" s: ")[2] for text in result.violations]


def wrong(change: Callable[[Plan], Plan]) -> Engine:
    """Robots whose plans are not quite right."""

    def plan_making(solver: Solver) -> PlanFunction:
        make_plan = FASTEST.plan_making(solver)

        def plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
            return change(make_plan(facts, alive))

        return plan

    return Engine(plan_making=plan_making)


def without_idle(plan: Plan) -> Plan:
    return replace(plan, idle=())


def turned_round(plan: Plan) -> Plan:
    return replace(plan, idle=plan.idle[::-1])


def with_a_timeout(plan: Plan) -> Plan:
    timeouts = (RunningTimeout(0, "0::", 10**12),)
    return replace(plan, evaluation=replace(plan.evaluation, timeouts=timeouts))


TIMES = [(wrong(lambda plan: plan), 1), (DEFINITIONS, 0)]


@pytest.mark.parametrize(
    ("change", "part"),
    [(without_idle, "idle"), (turned_round, "idle"), (with_a_timeout, "evaluation")],
)
def test_what_differs_is_said(change: Callable[[Plan], Plan], part: str) -> None:
    assert f"a plan is not that of the definitions: {part}" in violations(wrong(change))


@pytest.mark.parametrize(("engine", "times"), TIMES, ids=["changed", "definitions"])
def test_every_plan_is_compared_with_all_others(team: Team, engine: Engine, times: int) -> None:
    comparison = PlanComparison(engine)
    comparison.run = team.checkers.run
    facts, alive = team.views[0].facts, team.views[0].alive()
    plan = comparison.engine.plan_making(default_solver)
    plans = []
    for count in (1, 2, 3):
        plans.append(plan(facts, alive))
        assert comparison.compared == count * times
        team.agents[0].handle(ConditionSet("nominal", count % 2 == 1), team.clock.now_us)
    assert [plan.result for plan in plans] == [Status.RUNNING, Status.SUCCESS, Status.RUNNING]
    assert team.checkers.violations == []
