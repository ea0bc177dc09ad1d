"""The canonical one among all optimal assignments: the same whichever solver found one.

All optima differ by moves of robots that cost nothing, around cycles of the demands. So the
residual graph is compressed to one node per demand, one for "unassigned" (idle) and one for the
slack of the bounds. Shortest distances in it, the potentials, prove that the given assignment is
optimal, and tell which moves cost nothing (are *tight*). Robots that have more than one tight
option are fixed one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrbt_mesh.core.assignment.answer import checked
from mrbt_mesh.core.assignment.problem import (
    UNASSIGNED,
    AssignmentProblem,
    Integers,
    Solver,
    SolverError,
    supports_constraints,
)
from mrbt_mesh.core.assignment.solvers import cp_sat, default_solver, min_cost_flow
from mrbt_mesh.core.assignment.tie_breaking import first_of_ties

# Costs more than any way, and no sum of it and a way's cost is too large.
_CLOSED = 1 << 61


@dataclass(frozen=True, eq=False)
class ProvenOptimum:
    """An optimal assignment and what proves it.

    `choice` is a node per robot: a demand's index, or the number of demands for idle; `counts`
    are the robots per node. `potential` is a distance per node, and that of the slack as the last
    one: moving robot i from u to v costs p(i,u) - p(i,v), which with potential(u) - potential(v)
    is never below 0. `tight` are those of the problem's options for which it is 0.
    """

    problem: AssignmentProblem
    choice: Integers
    counts: Integers
    potential: Integers
    tight: Integers


def solve(problem: AssignmentProblem, solver: Solver) -> tuple[int, ...] | None:
    """The canonical optimum: a demand index or UNASSIGNED per robot; None if infeasible.

    Raises SolverError if the solver fails, or its answer is not an optimum, or wrongly none.
    """
    if not problem.demands:
        return (UNASSIGNED,) * len(problem.robots)
    if problem.constraints:
        return _solve_constrained(problem, solver)
    found = _ask(problem, solver)
    if found is not None:
        return canonical(problem, found)
    if solver not in _TRUSTED and min_cost_flow(problem) is not None:
        raise SolverError("it finds no assignment, but there is one")
    return None


# If one of these finds no assignment, it is not solved again.
_TRUSTED = (min_cost_flow, default_solver)


def _ask(problem: AssignmentProblem, solver: Solver) -> Sequence[int] | Integers | None:
    try:
        return solver(problem)
    except SolverError:
        raise
    except (Exception, SystemExit) as error:
        raise SolverError(f"it raised {type(error).__name__}: {error}") from error


def _solve_constrained(problem: AssignmentProblem, solver: Solver) -> tuple[int, ...] | None:
    """By CP-SAT, which proves what it finds: another solver's answer is held against that."""
    # Loaded here: the library is large.
    from mrbt_mesh.core.assignment.cp_sat import first_optimum

    if not supports_constraints(solver):
        raise SolverError("it does not mind side constraints: use cp_sat")
    best = first_optimum(problem)
    if solver not in (cp_sat, default_solver):
        found = _ask(problem, solver)
        if (found is None) != (best is None):
            raise SolverError("it is wrong about whether there is an assignment")
        if found is not None and best is not None:
            choice, _, _ = checked(problem, found)
            given = [UNASSIGNED if d == len(problem.demands) else d for d in choice.tolist()]
            broken = problem.violated(given)
            if broken is not None:
                raise SolverError(f"its assignment breaks the side constraint {broken}")
            if problem.objective(given) != problem.objective(best):
                raise SolverError("the assignment is not optimal: CP-SAT finds a better one")
    return None if best is None else tuple(best)


def canonical(problem: AssignmentProblem, optimum: Sequence[int] | Integers) -> tuple[int, ...]:
    """Among all optimal assignments, the canonical one.

    Robots in the problem's order; each takes the first demand, in order, that some optimal
    assignment consistent with the robots before it allows; unassigned comes last.
    Raises SolverError if `optimum` breaks a bound or is not optimal.
    """
    choice = first_optimum(proven(problem, optimum))
    idle = len(problem.demands)
    return tuple([UNASSIGNED if node == idle else node for node in choice])


def proven(problem: AssignmentProblem, optimum: Sequence[int] | Integers) -> ProvenOptimum:
    """Check that an assignment is feasible and optimal. Raises SolverError if it is not.

    By Bellman-Ford: a cycle that gains is a proof that the assignment was not optimal.
    """
    choice, counts, chosen = checked(problem, optimum)
    robots, nodes, performances = problem.options
    value = np.empty(len(choice), np.int64)
    value[robots[chosen]] = performances[chosen]
    slack, options = len(counts), len(nodes)
    every, to_slack = np.arange(slack), np.empty(slack, np.int64)
    to_slack.fill(slack)
    shut = np.concatenate((counts >= problem.upper, counts <= problem.lower))
    sources = np.concatenate((choice[robots], every, to_slack))
    targets = np.concatenate((nodes, to_slack, every))
    costs = np.concatenate((value[robots] - performances, shut * _CLOSED))
    distance = np.zeros(slack + 1, np.int64)
    reached = np.empty(len(sources), np.int64)
    for _ in range(slack + 2):
        distance.take(sources, out=reached, mode="clip")
        reached += costs
        nearer = distance.copy()
        np.minimum.at(nearer, targets, reached)
        if nearer.tobytes() == distance.tobytes():
            tight = (reached[:options] == distance[nodes]).nonzero()[0]
            return ProvenOptimum(problem, choice, counts, distance, tight)
        distance = nearer
    raise SolverError("the assignment is not optimal: moving robots around a cycle gains")


def first_optimum(found: ProvenOptimum) -> list[int]:
    """The canonical choice, a node per robot."""
    problem = found.problem
    robots, nodes, _ = problem.options
    # Where moves through the slack cost nothing: how many robots more or less a node may have.
    level = found.potential[:-1] == found.potential[-1]
    more = (level * (problem.upper - found.counts)).tolist()
    less = (level * (found.counts - problem.lower)).tolist()
    choice: list[int] = found.choice.tolist()
    return first_of_ties(choice, robots[found.tight], nodes[found.tight], more, less)
