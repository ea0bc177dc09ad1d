"""From scratch by names: whatever way a team's size calls for, it is the canonical optimum."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.assignment import canonical
from mrbt_mesh.core.assignment import solve as scratch
from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.problem import AssignmentProblem, Integers, SolverError
from mrbt_mesh.core.assignment.solvers import default_solver, min_cost_flow
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE
from tests.support.golden_assignments import SIZES, case
from tests.support.problems import optima, random_problem


def team_of(problem: AssignmentProblem) -> NamedProblem:
    """The same by names, with candidates that are not in the team."""
    rows = list(zip(problem.robots, problem.performance, strict=True))
    return NamedProblem(
        problem.robots,
        tuple(
            NamedDemand(
                demand.id,
                demand.lower,
                demand.upper,
                {"nobody": 9, **{robot: row[index] for robot, row in rows if index in row}},
            )
            for index, demand in enumerate(problem.demands)
        ),
    )


@pytest.mark.parametrize("seed", range(20))
def test_few_are_assigned_as_by_trying_everything(seed: int) -> None:
    draw = random.Random(seed)
    for number in range(60):
        problem = random_problem(draw)
        team, best = team_of(problem), optima(problem)
        expected = scratch.named(team, best[0]) if best else None
        assert scratch.of_few(team) == expected, f"{seed=} {number=}"


@given(st.integers(0, 10**9), st.integers(1, 30), st.integers(1, 9), st.sampled_from((1, 2, 10**6)))
def test_few_are_assigned_as_many_are(seed: int, robots: int, demands: int, most: int) -> None:
    draw = random.Random(seed)
    names = tuple(f"r{number:02}" for number in range(robots))
    offered = []
    for number in range(demands):
        able = {name: draw.randint(-most, most) for name in names if draw.random() < 0.6}
        lower = draw.randint(0, max(1, robots // demands))
        offered.append(NamedDemand(f"d{number}", lower, lower + draw.randrange(4), able))
    team = NamedProblem(names, tuple(offered))
    assert scratch.of_few(team) == scratch.named(team, solve(team.problem(), min_cost_flow))


@pytest.mark.parametrize("number", range(60))
def test_few_are_assigned_as_in_the_golden_file(number: int) -> None:
    for robots, demands, _, limited in SIZES[:2]:
        problem = case(robots, demands, number, limited)
        team = team_of(problem)
        assert scratch.of_few(team) == scratch.named(team, solve(problem, default_solver))


def test_no_performance_is_too_large() -> None:
    names = ("a", "b", "c")
    one = NamedDemand("one", 1, 1, dict.fromkeys(names, -MAX_PERFORMANCE))
    other = NamedDemand("other", 0, 1, dict.fromkeys(names, MAX_PERFORMANCE))
    assert scratch.of_few(NamedProblem(names, (one, other))) == {"a": "one", "b": "other"}
    assert scratch.of_few(NamedProblem(names, (other, one))) == {"a": "other", "b": "one"}


@given(
    st.lists(st.integers(-2, 4), max_size=6),
    st.integers(0, 3),
    st.integers(0, 3),
    st.lists(st.booleans(), min_size=6, max_size=6),
)
def test_one_demand_gets_its_best_robots(
    values: list[int], lower: int, more: int, able: list[bool]
) -> None:
    robots = tuple(f"R{number}" for number in range(len(values)))
    candidates = {robot: p for robot, p, can in zip(robots, values, able, strict=False) if can}
    team = NamedProblem(robots, (NamedDemand("d", lower, lower + more, candidates),))
    assert scratch.of_one(team) == scratch.named(team, solve(team.problem(), min_cost_flow))


def test_a_solver_of_the_users_is_asked_whatever_the_size() -> None:
    """So that one that breaks its contract is found out."""

    def refuses(problem: AssignmentProblem) -> Integers | None:
        raise SolverError("never")

    team = NamedProblem(
        ("a", "b"), (NamedDemand("x", 1, 1, {"a": 1}), NamedDemand("y", 1, 1, {"a": 1, "b": 1}))
    )
    with pytest.raises(SolverError, match="never"):
        scratch.optimum(team, refuses)
    assert scratch.optimum(team, default_solver) == {"a": "x", "b": "y"}


def test_arrays_are_for_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the size alone, and whichever it is: the same answer."""
    demands = tuple(NamedDemand(f"d{n}", 1, 2, {"a": n, "b": 3 - n, "c": 1}) for n in range(2))
    team = NamedProblem(("a", "b", "c"), demands)
    few = scratch.optimum(team, default_solver)
    asked: list[AssignmentProblem] = []

    def watched(problem: AssignmentProblem, solver: object) -> tuple[int, ...] | None:
        asked.append(problem)
        return solve(problem, default_solver)

    monkeypatch.setattr(canonical, "solve", watched)
    for limit, calls in ((6, 0), (5, 1)):
        monkeypatch.setattr(scratch, "FEW", limit)
        asked.clear()
        assert scratch.optimum(team, default_solver) == few
        assert len(asked) == calls
