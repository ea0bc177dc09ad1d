"""Solvers of the assignment problem: each exact, and the same canonical answer from all."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from mrbt_mesh.core.assignment.canonical import canonical, solve
from mrbt_mesh.core.assignment.problem import (
    UNASSIGNED,
    AssignmentProblem,
    Bounds,
    Solver,
    SolverError,
)
from mrbt_mesh.core.assignment.solvers import (
    SOLVERS,
    cp_sat,
    default_solver,
    min_cost_flow,
)
from tests.support.effort import seeds
from tests.support.oracle import brute_force
from tests.support.problems import last_optimum, permuted, perturbed, random_problem

CASES_PER_SEED = 500


@pytest.mark.parametrize("seed", seeds(10))
def test_cases_with_ties_have_one_answer_whoever_solves_them(seed: int) -> None:
    draw = random.Random(seed)
    feasible = ambiguous = 0
    for case in range(CASES_PER_SEED):
        problem = random_problem(draw)
        expected = brute_force(problem)
        feasible += expected is not None
        contrary = last_optimum(problem)
        ambiguous += contrary is not None and tuple(contrary) != expected
        solvers: dict[str, Solver] = {
            **SOLVERS,
            "permuted": permuted(min_cost_flow, draw),
            "perturbed": perturbed(min_cost_flow, draw),
            "permuted and perturbed": permuted(perturbed(min_cost_flow, draw), draw),
            "last": lambda _, answer=contrary: answer,
        }
        for name, solver in solvers.items():
            assert solve(problem, solver) == expected, f"seed {seed}, case {case}: {name}"
    # The cases are worth something only if many have an answer, and many of these others too.
    assert feasible > CASES_PER_SEED // 3
    assert ambiguous > CASES_PER_SEED // 5


@pytest.mark.parametrize("seed", seeds(5))
@pytest.mark.parametrize(("robots", "demands"), [(30, 20), (60, 15)])
def test_so_have_larger_ones(robots: int, demands: int, seed: int) -> None:
    draw = random.Random(f"{seed}/{robots}")
    bounds = [Bounds(f"d{number}", 1, 1 + draw.randrange(3)) for number in range(demands)]
    rows = [
        {d: draw.choice((5, 5, 6, 7)) for d in range(demands) if draw.random() < 0.5}
        for _ in range(robots)
    ]
    problem = AssignmentProblem.of([f"r{n:02}" for n in range(robots)], bounds, rows)
    expected = solve(problem, min_cost_flow)
    assert expected is not None
    assert solve(problem, cp_sat) == expected
    for _ in range(5):
        assert solve(problem, permuted(perturbed(min_cost_flow, draw), draw)) == expected
        assert canonical(problem, permuted(cp_sat, draw)(problem) or ()) == expected


# -- what a solver may not do -----------------------------------------------------------------


def _two_robots() -> AssignmentProblem:
    return AssignmentProblem.of(("r1", "r2"), (Bounds("d1", 1, 1),), ({0: 5}, {0: 7}))


def _raise(error: BaseException) -> Any:
    raise error


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda _: _raise(ValueError("no luck")), "it raised ValueError: no luck"),
        (lambda _: _raise(SystemExit(3)), "it raised SystemExit: 3"),
        (lambda _: None, "it finds no assignment, but there is one"),
        (lambda _: [0], "1 answers for 2 robots"),
        (lambda _: [0, -1], "not optimal"),
        (lambda _: [0, 0], r"2 robots on d1, 1\.\.1"),
        (lambda _: [-1, 3], "r2: no demand 3"),
        (lambda _: 7, "one whole number per robot is expected, it returned 7"),
        (lambda _: {"r2": 0}, "one whole number per robot is expected, it returned {'r2': 0}"),
        (lambda _: [-1, 0.5], "one whole number per robot is expected"),
        (lambda _: [True, False], "one whole number per robot is expected"),
        (lambda _: [[-1], [0, 0]], "one whole number per robot is expected"),
        (lambda _: [-1, 1 << 70], "one whole number per robot is expected"),
        (lambda p: p.pair_performance.sort(), "it raised ValueError: .*read-only"),
    ],
)
def test_what_breaks_the_contract_is_told(
    answer: Callable[[AssignmentProblem], Any], message: str
) -> None:
    with pytest.raises(SolverError, match=message):
        solve(_two_robots(), answer)


def test_a_keyboard_interrupt_is_not_the_solvers_fault() -> None:
    with pytest.raises(KeyboardInterrupt):
        solve(_two_robots(), lambda _: _raise(KeyboardInterrupt()))


def test_any_sequence_of_numbers_is_an_answer() -> None:
    answers: Sequence[Any] = ([-1, 0], (-1, 0), np.array([-1, 0]))
    assert {solve(_two_robots(), lambda _, a=a: a) for a in answers} == {(UNASSIGNED, 0)}


def test_the_registry_is_what_the_documents_list() -> None:
    assert {"min_cost_flow": min_cost_flow, "cp_sat": cp_sat} == SOLVERS
    assert solve(_two_robots(), default_solver) == (UNASSIGNED, 0)
