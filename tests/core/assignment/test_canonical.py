"""*Assign Agents*: optimal, feasible, and the same canonical answer from any optimum."""

from __future__ import annotations

import random
from collections.abc import Sequence
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.assignment import tie_breaking
from mrbt_mesh.core.assignment.canonical import canonical, solve
from mrbt_mesh.core.assignment.problem import UNASSIGNED, AssignmentProblem, Bounds, SolverError
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE
from tests.support.problems import feasible, optima


def problem(demands: Sequence[tuple[int, int]], *performance: dict[int, int]) -> AssignmentProblem:
    robots = tuple(f"r{number}" for number in range(len(performance)))
    bounds = tuple(Bounds(f"d{i}", low, high) for i, (low, high) in enumerate(demands))
    return AssignmentProblem.of(robots, bounds, performance)


@st.composite
def problems(draw: st.DrawFn) -> AssignmentProblem:
    """Small problems with many ties."""
    demands = draw(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), max_size=4))
    bounds = [(low, low + more) for low, more in demands]
    values = st.sampled_from((1, 1, 1, 2, 3))
    rows = st.dictionaries(st.integers(0, len(bounds) - 1), values) if bounds else st.just({})
    return problem(bounds, *draw(st.lists(rows, max_size=5)))


@given(problems())
def test_the_default_solver_finds_the_canonical_optimum_or_that_there_is_none(
    given_problem: AssignmentProblem,
) -> None:
    best = optima(given_problem)
    assert solve(given_problem, min_cost_flow) == (best[0] if best else None)


@given(problems(), st.data())
def test_the_answer_does_not_depend_on_the_optimum_that_a_solver_found(
    given_problem: AssignmentProblem, data: st.DataObject
) -> None:
    best = optima(given_problem)
    if best:
        found = data.draw(st.sampled_from(best))
        assert canonical(given_problem, found) == best[0]


@pytest.mark.parametrize(("many", "few"), [(0, 8), (0, 0), (16, 0), (2, 1)])
def test_the_answer_does_not_depend_on_how_ties_are_searched(many: int, few: int) -> None:
    draw = random.Random(many + few)
    for _ in range(10):
        rows = [dict.fromkeys(draw.sample(range(30), 4), 1) for _ in range(60)]
        taken = [draw.choice(list(row)) for row in rows]
        bounds = [(max(0, taken.count(d) - 1), taken.count(d) + d % 2) for d in range(30)]
        tied = problem(bounds, *rows)
        expected = solve(tied, min_cost_flow)
        with mock.patch.multiple(tie_breaking, _MANY=many, _FEW=few):
            assert canonical(tied, taken) == expected


@given(problems(), st.sampled_from((0, 2, 16)), st.sampled_from((0, 1, 8)))
def test_every_way_to_search_ties_finds_the_canonical_optimum(
    given_problem: AssignmentProblem, many: int, few: int
) -> None:
    best = optima(given_problem)
    if best:
        with mock.patch.multiple(tie_breaking, _MANY=many, _FEW=few):
            assert canonical(given_problem, best[-1]) == best[0]


@given(problems())
def test_every_answer_that_is_not_optimal_is_refused(given_problem: AssignmentProblem) -> None:
    best = optima(given_problem)
    for choice in feasible(given_problem):
        if choice not in best:
            with pytest.raises(SolverError, match="not optimal"):
                canonical(given_problem, choice)


@given(problems(), st.data())
def test_every_answer_that_is_not_feasible_is_refused(
    given_problem: AssignmentProblem, data: st.DataObject
) -> None:
    numbers = st.integers(-3, len(given_problem.demands) + 2)
    choice = tuple(data.draw(st.lists(numbers, max_size=6)))
    if choice not in set(feasible(given_problem)):
        with pytest.raises(SolverError):
            canonical(given_problem, choice)


@given(problems())
def test_performances_of_any_size_are_exact(given_problem: AssignmentProblem) -> None:
    large = AssignmentProblem.of(
        given_problem.robots,
        given_problem.demands,
        tuple(
            {d: MAX_PERFORMANCE - 3 + p for d, p in row.items()}
            for row in given_problem.performance
        ),
    )
    best = optima(large)
    assert solve(large, min_cost_flow) == (best[0] if best else None)


def test_robots_in_sorted_order_take_the_first_demand_that_an_optimum_allows() -> None:
    everything_equal = {0: 1, 1: 1}
    found = solve(problem([(1, 1), (1, 1)], *[everything_equal] * 3), min_cost_flow)
    assert found == (0, 1, UNASSIGNED)


def test_unassigned_comes_last_even_where_it_costs_nothing() -> None:
    assert solve(problem([(0, 1)], {0: 0}, {0: 0}), min_cost_flow) == (0, UNASSIGNED)


def test_performance_goes_before_order() -> None:
    assert solve(problem([(1, 1), (1, 1)], {0: 1, 1: 2}, {0: 2, 1: 1}), min_cost_flow) == (1, 0)


def test_lower_bounds_go_before_performance() -> None:
    assert solve(problem([(1, 1), (0, 1)], {0: 1, 1: 99}), min_cost_flow) == (0,)


@pytest.mark.parametrize(
    ("demands", "robots"),
    [
        ([(1, 1)], []),
        ([(2, 2)], [{0: 1}]),
        ([(1, 1), (1, 1)], [{0: 1, 1: 1}]),
        ([(1, 1), (1, 1)], [{0: 1}, {0: 1}]),
    ],
)
def test_where_no_assignment_keeps_the_bounds_there_is_none(
    demands: list[tuple[int, int]], robots: list[dict[int, int]]
) -> None:
    assert solve(problem(demands, *robots), min_cost_flow) is None


def test_nothing_to_assign_is_feasible() -> None:
    assert solve(problem([]), min_cost_flow) == ()
    assert solve(problem([], {}, {}), min_cost_flow) == (UNASSIGNED, UNASSIGNED)
    assert solve(problem([(0, 3)]), min_cost_flow) == ()


def test_what_a_broken_solver_did_is_told() -> None:
    two = problem([(1, 1)], {0: 5}, {0: 7})
    with pytest.raises(SolverError, match="not optimal"):
        solve(two, lambda _: [0, UNASSIGNED])
    with pytest.raises(SolverError, match=r"2 robots on d0, 1\.\.1"):
        solve(two, lambda _: [0, 0])
    with pytest.raises(SolverError, match="r0 cannot do d0"):
        solve(problem([(1, 1)], {}, {0: 7}), lambda _: [0, UNASSIGNED])
    with pytest.raises(SolverError, match="1 answers for 2 robots"):
        solve(two, lambda _: [0])


@pytest.mark.parametrize("number", [5, 1, -2])
def test_a_demand_that_is_none_is_told(number: int) -> None:
    with pytest.raises(SolverError, match=f"r1: no demand {number}"):
        solve(problem([(1, 1)], {0: 5}, {0: 7}), lambda _: [0, number])


def test_a_large_team_is_assigned_at_once() -> None:
    count = 300
    rows = [{d: 1 + (r * 7 + d * 3) % 5 for d in range(60)} for r in range(count)]
    found = solve(problem([(1, 3)] * 60, *rows), min_cost_flow)
    assert found is not None
    assert all(1 <= found.count(d) <= 3 for d in range(60))
    assert found == solve(problem([(1, 3)] * 60, *rows), min_cost_flow)
