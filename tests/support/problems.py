"""Random assignment problems, and solvers that are contrary on purpose."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from mrbt_mesh.core.assignment.problem import (
    UNASSIGNED,
    AssignmentProblem,
    Bounds,
    Limit,
    Shared,
    SideConstraint,
    Solver,
    integers,
)


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


def feasible(problem: AssignmentProblem) -> Iterator[tuple[int, ...]]:
    """All assignments within the bounds, by trying everything."""
    options = [[*sorted(can), UNASSIGNED] for can in problem.performance]
    for choice in itertools.product(*options):
        counts = [choice.count(number) for number in range(len(problem.demands))]
        pairs = zip(counts, problem.demands, strict=True)
        if all(bounds.lower <= count <= bounds.upper for count, bounds in pairs):
            yield choice


def optima(problem: AssignmentProblem) -> list[tuple[int, ...]]:
    """All optimal assignments; the canonical one is first."""
    found = list(feasible(problem))
    best = max(map(problem.objective, found), default=0)
    order = len(problem.demands)
    return sorted(
        (choice for choice in found if problem.objective(choice) == best),
        key=lambda choice: [order if d == UNASSIGNED else d for d in choice],
    )


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
        noise = integers(draw.randrange(10) for _ in problem.pair_robot)
        scale = 10 * (len(problem.robots) + 1)
        return solver(replace(problem, pair_performance=problem.pair_performance * scale + noise))

    return solve_perturbed


def last_optimum(problem: AssignmentProblem) -> list[int] | None:
    """The optimum that the canonical order puts last: the answer of a contrary solver."""
    best: tuple[int, ...] | None = None
    for choice in feasible(problem):
        if best is None or problem.objective(choice) >= problem.objective(best):
            best = choice
    return None if best is None else list(best)


def random_limits(draw: random.Random, robots: int, demands: int) -> tuple[SideConstraint, ...]:
    """A few limits, some of which bind."""
    found: list[SideConstraint] = []
    for _ in range(draw.randrange(1, 4)):
        if robots and draw.random() < 0.6:
            who = sorted(draw.sample(range(robots), draw.randrange(1, robots + 1)))
            what = sorted(draw.sample(range(demands), draw.randrange(1, demands + 1)))
            found.append(Limit(tuple(who), tuple(what), draw.randrange(3)))
        else:
            order = draw.sample(range(demands), demands)
            cuts = sorted(draw.sample(range(demands + 1), min(2, demands)))
            groups = (order[: cuts[0]], order[cuts[0] : cuts[-1]], order[cuts[-1] :])
            found.append(Shared(tuple(tuple(sorted(g)) for g in groups if g), draw.randrange(3)))
    return tuple(found)


def limited(draw: random.Random) -> AssignmentProblem:
    problem = random_problem(draw)
    limits = random_limits(draw, len(problem.robots), len(problem.demands))
    return replace(problem, constraints=limits)
