"""Solvers of the assignment problem: each exact, and the same canonical answer from all."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mrbt_mesh.core.assignment import UNASSIGNED, AssignmentProblem, Bounds, Solver, SolverError
from mrbt_mesh.core.canonical import canonical, solve
from mrbt_mesh.core.solvers import (
    MAX_CHOICES,
    SOLVERS,
    brute_force,
    cp_sat,
    default_solver,
    min_cost_flow,
)

CASES_PER_SEED = 500


def random_problem(draw: random.Random) -> AssignmentProblem:
    """A small problem with many ties; about a third of them have no solution."""
    demands = draw.randrange(1, 5)
    bounds = []
    for number in range(demands):
        lower = draw.choice((0, 0, 1, 1, 2))
        bounds.append(Bounds(f"d{number}", lower, lower + draw.randrange(3)))
    values = draw.choice(((1,), (1, 1, 2), (0, 1, 1, 2, 3), (-1, 0, 1)))
    density = draw.choice((0.4, 0.7, 1.0))
    rows = [
        {d: draw.choice(values) for d in range(demands) if draw.random() < density}
        for _ in range(draw.randrange(7))
    ]
    return AssignmentProblem.of([f"r{number}" for number in range(len(rows))], bounds, rows)


def permuted(solver: Solver, draw: random.Random) -> Solver:
    """The same solver, given robots, demands and arcs in another order."""

    def solve_permuted(problem: AssignmentProblem) -> list[int] | None:
        robots = draw.sample(range(len(problem.robots)), len(problem.robots))
        demands = draw.sample(range(len(problem.demands)), len(problem.demands))
        arcs = draw.sample(range(len(problem.pair_robot)), len(problem.pair_robot))
        answer = solver(
            AssignmentProblem(
                tuple(problem.robots[i] for i in robots),
                tuple(problem.demands[d] for d in demands),
                _numbers([robots.index(problem.pair_robot[a]) for a in arcs], problem),
                _numbers([demands.index(problem.pair_demand[a]) for a in arcs], problem),
                problem.pair_performance[arcs],
            )
        )
        if answer is None:
            return None
        back = [UNASSIGNED] * len(robots)
        for place, chosen in enumerate(answer):
            back[robots[place]] = UNASSIGNED if chosen == UNASSIGNED else demands[int(chosen)]
        return back

    return solve_permuted


def _numbers(values: list[int], problem: AssignmentProblem) -> Any:
    result = problem.pair_robot.copy()
    result[:] = values
    return result


def perturbed(solver: Solver, draw: random.Random) -> Solver:
    """The same solver, on costs with their ties broken at random, too little to change the rest."""

    def solve_perturbed(problem: AssignmentProblem) -> Any:
        noise = [draw.randrange(10) for _ in problem.pair_robot]
        scale = 10 * (len(problem.robots) + 1)
        return solver(replace(problem, pair_performance=problem.pair_performance * scale + noise))

    return solve_perturbed


def last_optimum(problem: AssignmentProblem) -> list[int] | None:
    """The optimum that the canonical order puts last: what a contrary solver would find."""
    options = [[*sorted(can), UNASSIGNED] for can in problem.performance]
    best: tuple[int, tuple[int, ...]] | None = None
    for choice in itertools.product(*options):
        counts = [choice.count(number) for number in range(len(problem.demands))]
        pairs = zip(counts, problem.demands, strict=True)
        if all(bounds.lower <= count <= bounds.upper for count, bounds in pairs):
            value = problem.objective(choice)
            if best is None or value >= best[0]:
                best = value, choice
    return None if best is None else list(best[1])


@pytest.mark.parametrize("seed", range(10))
def test_5000_cases_with_ties_have_one_answer_whoever_solves_them(seed: int) -> None:
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


@pytest.mark.parametrize("seed", range(4))
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


def test_brute_force_refuses_what_would_take_for_ever() -> None:
    rows = [{0: 1, 1: 1}] * 12
    problem = AssignmentProblem.of([f"r{n:02}" for n in range(12)], [Bounds("d", 0, 9)] * 2, rows)
    assert MAX_CHOICES < 3**12
    with pytest.raises(SolverError, match="at most 200,000 combinations; these 12 robots have"):
        solve(problem, brute_force)


def test_the_registry_is_what_the_documents_list() -> None:
    assert {
        "min_cost_flow": min_cost_flow,
        "cp_sat": cp_sat,
        "brute_force": brute_force,
    } == SOLVERS
    assert solve(_two_robots(), default_solver) == (UNASSIGNED, 0)
