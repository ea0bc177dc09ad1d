"""A solver in a process of its own answers as it would here, and its end is noticed."""

from __future__ import annotations

import os
from collections.abc import Iterator

import psutil
import pytest

from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.problem import AssignmentProblem, Bounds, SolverError
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.runtime.solver_process import SolverProcess

pytestmark = pytest.mark.processes


def problem(robots: int = 6) -> AssignmentProblem:
    rows = [{0: 1 + r % 3, 1: 2} for r in range(robots)]
    bounds = [Bounds("a", 1, 2), Bounds("b", 0, 3)]
    return AssignmentProblem.of([f"r{r}" for r in range(robots)], bounds, rows)


def broken(problem: AssignmentProblem) -> None:
    raise ValueError("out of order")


def deadly(problem: AssignmentProblem) -> None:
    os._exit(3)


@pytest.fixture
def apart() -> Iterator[SolverProcess]:
    solver = SolverProcess(min_cost_flow, large_pairs=4)
    yield solver
    solver.close()


def test_it_answers_as_the_solver_does(apart: SolverProcess) -> None:
    for robots in (1, 2, 6, 30):
        assert solve(problem(robots), apart) == solve(problem(robots), min_cost_flow)
    assert apart(AssignmentProblem.of(["r"], [Bounds("a", 2, 2)], [{0: 1}])) is None


def test_small_problems_need_no_process() -> None:
    apart = SolverProcess(min_cost_flow)
    assert solve(problem(), apart) == solve(problem(), min_cost_flow)
    assert apart.pid is None
    apart.close()


def test_what_a_solver_raises_arrives() -> None:
    apart = SolverProcess(broken, large_pairs=0)
    for _ in range(2):
        with pytest.raises(ValueError, match="out of order"):
            apart(problem())
    apart.close()


def test_a_process_that_has_ended_is_started_anew(apart: SolverProcess) -> None:
    first = solve(problem(), apart)
    assert apart.pid is not None
    child = psutil.Process(apart.pid)
    child.kill()
    assert solve(problem(), apart) == first
    assert apart.pid != child.pid


def test_a_solver_that_takes_its_process_down_is_told() -> None:
    apart = SolverProcess(deadly, large_pairs=0)
    with pytest.raises(SolverError, match="ends at once"):
        apart(problem())
    assert apart.pid is None


def test_nothing_is_left_when_it_is_closed() -> None:
    apart = SolverProcess(min_cost_flow, large_pairs=0)
    solve(problem(), apart)
    assert apart.pid is not None
    child = psutil.Process(apart.pid)
    apart.close()
    apart.close()
    assert not child.is_running()
    assert apart.pid is None
