"""Teams whose robots solve the assignment problem in different ways, or wrongly, still agree."""

from __future__ import annotations

from typing import Any

import pytest
from runs import example

from mrbt_mesh.core.assignment import AssignmentProblem, Solver, SolverError
from mrbt_mesh.core.solvers import brute_force, cp_sat, min_cost_flow
from mrbt_mesh.sim import SimulationResult, simulate
from mrbt_mesh.sim import faults as f

SECOND_US = 1_000_000
SCHEDULE = ((5 * SECOND_US, f.Kill("C2")), (9 * SECOND_US, f.Restart("C2")))


def backwards(problem: AssignmentProblem) -> Any:
    """Another optimum where there are several: that of the demands in the opposite order."""
    last = len(problem.demands) - 1
    rows = [{last - d: p for d, p in row.items()} for row in problem.performance]
    found = min_cost_flow(AssignmentProblem.of(problem.robots, problem.demands[::-1], rows))
    return None if found is None else [last - d if d >= 0 else d for d in found.tolist()]


def story(result: SimulationResult) -> tuple[Any, ...]:
    """What was done and when, and the last plans."""
    plans = {robot: agent.plan.packed for robot, agent in result.agents.items() if agent.plan}
    return result.result, result.duration_us, result.events, plans


@pytest.mark.parametrize("schedule", [(), SCHEDULE])
def test_robots_with_different_solvers_make_the_same_plans(schedule: Any) -> None:
    mission, program = example("vehicle_repair")
    solvers: dict[str, Solver] = {
        "A1": cp_sat,
        "A2": brute_force,
        "B1": min_cost_flow,
        "B2": backwards,
    }
    plain = simulate(mission, program, seed=3, schedule=schedule)
    mixed = simulate(mission, program, seed=3, schedule=schedule, solvers=solvers)
    # I1: equal facts, equal plan, to the byte; I7: each the canonical optimum.
    assert mixed.violations == []
    assert mixed.checks["I1"] >= 10
    assert mixed.checks["I7"] >= 1
    assert mixed.result == "success"
    assert story(mixed) == story(plain)


def _raises(problem: AssignmentProblem) -> Any:
    raise RuntimeError("out of order")


def _refuses(problem: AssignmentProblem) -> Any:
    raise SolverError("too large for me")


BROKEN: dict[str, tuple[Solver, str]] = {
    "raises": (_raises, "it raised RuntimeError: out of order"),
    "refuses": (_refuses, "too large for me"),
    "finds nothing": (lambda problem: None, "it finds no assignment, but there is one"),
    "leaves all idle": (lambda problem: [-1] * len(problem.robots), "0 robots on "),
    "returns nonsense": (lambda problem: "nonsense", "one whole number per robot"),  # type: ignore
    "one too many": (lambda problem: [-1] * (len(problem.robots) + 1), "answers for "),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_robot_with_a_broken_solver_plans_as_the_others_and_says_so_once(kind: str) -> None:
    solver, reason = BROKEN[kind]
    mission, program = example("vehicle_repair")
    plain = simulate(mission, program, seed=3)
    result = simulate(mission, program, seed=3, solvers={"B1": solver}, keep_log=True)
    assert result.violations == []
    assert story(result) == story(plain)
    (line,) = [line for line in result.effect_log if "solver_failed" in line]
    assert " B1 " in line
    assert reason in line
    count = result.agents["B1"].refusals.counts["solver: broke its contract"]
    assert count > 5
    assert "solver: broke its contract" not in result.agents["A1"].refusals.counts


def test_nor_does_it_matter_where_robots_plan_together() -> None:
    mission, program = example("vehicle_repair")
    plain = simulate(mission, program, seed=3, inspect=False)
    for broken in (dict.fromkeys(mission.robots, _raises), {"A1": _raises}):
        result = simulate(mission, program, seed=3, solvers=broken, inspect=False)
        assert story(result) == story(plain)
