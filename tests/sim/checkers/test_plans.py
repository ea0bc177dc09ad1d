"""I1 and I7: the same plan everywhere, and an assignment that is optimal and canonical."""

from __future__ import annotations

import dataclasses
import random

import pytest

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.problem import AssignmentProblem, Bounds, SolverError
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.sim import simulate
from mrbt_mesh.sim.checkers.plans import optimal_assignment
from tests.support import inside
from tests.support.checked_team import SECOND_US, Team
from tests.support.oracle import brute_force
from tests.support.runs import example


def test_i1_plans_that_differ_on_the_same_facts(team: Team) -> None:
    facts = team.agents[0].view.facts
    facts.run = "another"
    facts.changes += 1
    assert "I1" in team.sample()


def problem(*performance: dict[int, int], bounds: list[tuple[int, int]]) -> AssignmentProblem:
    robots = tuple(f"R{i}" for i in range(len(performance)))
    demands = tuple(Bounds(f"d{i}", *each) for i, each in enumerate(bounds))
    return AssignmentProblem.of(robots, demands, performance)


@pytest.mark.parametrize("seed", range(40))
def test_i7_brute_force_and_the_product_find_the_same(seed: int) -> None:
    choose = random.Random(seed)
    count = choose.randint(1, 3)
    performance = [
        {d: choose.choice([1, 2, 2]) for d in range(count) if choose.random() < 0.7}
        for _ in range(choose.randint(1, 5))
    ]
    bounds = [(low := choose.randint(0, 2), low + choose.randint(0, 2)) for _ in range(count)]
    given = problem(*performance, bounds=bounds)
    assert brute_force(given) == solve(given, min_cost_flow)


def test_i7_brute_force_takes_the_first_of_the_best() -> None:
    given = problem({0: 1, 1: 1}, {0: 1, 1: 1}, bounds=[(0, 1), (0, 1)])
    assert brute_force(given) == (0, 1)
    assert brute_force(problem({0: 1}, bounds=[(2, 2)])) is None


def test_i7_an_assignment_that_is_not_the_canonical_one() -> None:
    agent = _waiting_for_work()
    team = Team([agent])
    team.solver = lambda problem: [-1] * len(problem.robots)
    with pytest.raises(SolverError):
        optimal_assignment(team.checkers.run, agent.view)


def _waiting_for_work() -> Agent:
    """An agent whose plan has something to assign: two areas, and nobody is at them."""
    mission, program = example("explore")
    result = simulate(mission, program, seed=1, timeout_us=2 * SECOND_US)
    agent = result.agents["R1"]
    agent.view.facts.claims.clear()
    agent.view.facts.changes += 1
    return agent


def test_i7_a_plan_that_is_not_that_of_its_facts() -> None:
    agent = _waiting_for_work()
    team = Team([agent])
    optimal_assignment(team.checkers.run, agent.view)
    assert team.checkers.violations == []
    assert team.checkers.checks["I7"] == 1
    assert agent.view.plan is not None
    agent.view.facts.changes -= 1
    inside.planner(agent).plan = dataclasses.replace(agent.view.plan, assignments={})
    optimal_assignment(team.checkers.run, agent.view)
    assert "the plan of R1 is not that of its facts" in team.checkers.violations[0]
