"""Side constraints of the assignment problem: exact, and one answer from every solver."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.assignment import cp_sat as model
from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.problem import (
    UNASSIGNED,
    AssignmentProblem,
    Bounds,
    Limit,
    Shared,
    SolverError,
)
from mrbt_mesh.core.assignment.solvers import cp_sat, default_solver, min_cost_flow
from tests.support.oracle import brute_force
from tests.support.problems import limited

CASES_PER_SEED = 150


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_cp_sat_finds_what_trying_out_everything_finds_first(seed: int) -> None:
    draw = random.Random(seed)
    feasible = binding = 0
    for case in range(CASES_PER_SEED):
        problem = limited(draw)
        expected = brute_force(problem)
        feasible += expected is not None
        binding += expected != brute_force(replace(problem, constraints=()))
        for solver in (cp_sat, brute_force, default_solver):
            assert solve(problem, solver) == expected, f"seed {seed}, case {case}: {solver}"
        assert model.is_feasible(problem) == (expected is not None)
    assert feasible > CASES_PER_SEED // 5
    assert binding > CASES_PER_SEED // 5


def _equal_robots(robots: int, demands: int) -> AssignmentProblem:
    rows = [dict.fromkeys(range(demands), 1) for _ in range(robots)]
    bounds = [Bounds(f"d{number}", 1, 3) for number in range(demands)]
    limits = (
        *(Limit((r, r + 1), (d,), 1) for r in range(0, robots - 1, 2) for d in range(demands)),
        Limit(tuple(range(4)), tuple(range(demands)), 2),
        Shared(((0,), (1, 2)), 2),
    )
    return AssignmentProblem.of([f"r{n:02}" for n in range(robots)], bounds, rows, limits)


def test_it_matters_not_in_how_many_pieces_the_canonical_one_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = _equal_robots(14, 4)
    expected = solve(problem, cp_sat)
    assert expected is not None
    assert problem.violated(expected) is None
    for largest in (1, 20, 1 << 12):
        monkeypatch.setattr(model, "LARGEST", largest)
        assert solve(problem, cp_sat) == expected, largest


def test_performances_of_any_size_are_exact_within_constraints() -> None:
    large = 10**12
    rows = [{0: large, 1: large - 1}, {0: large, 1: large}, {0: large - 1, 1: large}]
    bounds = (Bounds("d1", 0, 2), Bounds("d2", 0, 2))
    limit = Limit((0, 1), (0,), 1)
    problem = AssignmentProblem.of(("a", "b", "c"), bounds, rows, (limit,))
    assert solve(problem, cp_sat) == brute_force(problem) == (0, 1, 1)


def test_limits_that_cannot_bind_change_nothing() -> None:
    problem = replace(_equal_robots(6, 2), constraints=())
    loose = replace(problem, constraints=(Limit((0, 1), (0, 1), 2), Shared(((0,), (1,)), 2)))
    assert solve(loose, cp_sat) == solve(problem, min_cost_flow)


# -- which solvers may be asked ---------------------------------------------------------------


def _rivals() -> AssignmentProblem:
    """Two robots of which one may work; the second one is better."""
    rows: list[dict[int, int]] = [{0: 1}, {0: 2}]
    limit = Limit((0, 1), (0,), 1)
    return AssignmentProblem.of(("a", "b"), (Bounds("d", 0, 2),), rows, (limit,))


def test_min_cost_flow_refuses_constraints() -> None:
    with pytest.raises(SolverError, match="does not mind side constraints: use cp_sat"):
        solve(_rivals(), min_cost_flow)
    with pytest.raises(SolverError, match="knows no side constraints: use cp_sat"):
        min_cost_flow(_rivals())


def test_a_users_solver_has_to_say_that_it_minds_them() -> None:
    def mine(problem: AssignmentProblem) -> Any:
        return [UNASSIGNED, 0]

    with pytest.raises(SolverError, match="does not mind side constraints"):
        solve(_rivals(), mine)
    mine.supports_constraints = True  # type: ignore[attr-defined]
    assert solve(_rivals(), mine) == (UNASSIGNED, 0)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ([0, 0], r"its assignment breaks the side constraint Limit\(robots=\(0, 1\)"),
        ([0, -1], "not optimal"),
        ([0], "1 answers for 2 robots"),
        (None, "wrong about whether there is an assignment"),
    ],
)
def test_and_what_it_finds_is_held_against_cp_sat(answer: Any, message: str) -> None:
    def mine(problem: AssignmentProblem) -> Any:
        return answer

    mine.supports_constraints = True  # type: ignore[attr-defined]
    with pytest.raises(SolverError, match=message):
        solve(_rivals(), mine)


def test_what_is_infeasible_has_no_answer() -> None:
    problem = replace(_rivals(), demands=(Bounds("d", 2, 2),))
    assert solve(problem, cp_sat) is None

    def invents(problem: AssignmentProblem) -> Any:
        return [0, 0]

    invents.supports_constraints = True  # type: ignore[attr-defined]
    with pytest.raises(SolverError, match="wrong about whether there is an assignment"):
        solve(problem, invents)
