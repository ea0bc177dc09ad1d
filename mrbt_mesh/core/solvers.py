"""Solvers of the assignment problem. `SOLVERS` is where a user's own one is registered.

A solver is a function from AssignmentProblem to any optimum; the canonical pass does the rest.
"""

from __future__ import annotations

import numpy as np
from ortools.graph.python.min_cost_flow import SimpleMinCostFlow

from mrbt_mesh.core.assignment import (
    UNASSIGNED,
    AssignmentProblem,
    Integers,
    Solver,
    SolverError,
)


def min_cost_flow(problem: AssignmentProblem) -> Integers | None:
    """Solve as a transportation problem with OR-tools' min-cost flow; polynomial and exact.

    Every robot sends one unit to a demand or to the pool. A demand keeps its lower bound and
    passes up to (upper - lower) on to the pool, so that feasibility needs no penalty cost.
    """
    robots, demands, pairs = len(problem.robots), len(problem.demands), len(problem.pair_robot)
    pool = robots + demands
    spare = robots - int(problem.lower.sum())
    if spare < 0:
        return None
    nodes = np.arange(pool + 1)
    flow = SimpleMinCostFlow()
    flow.add_arcs_with_capacity_and_unit_cost(
        np.concatenate((problem.pair_robot, nodes[:pool])),
        np.concatenate((problem.pair_demand + robots, np.full(pool, pool))),
        np.concatenate((np.ones(pairs + robots, np.int64), (problem.upper - problem.lower)[:-1])),
        np.concatenate((-problem.pair_performance, np.zeros(pool, np.int64))),
    )
    flow.set_nodes_supplies(
        nodes, np.concatenate((np.ones(robots, np.int64), -problem.lower[:-1], [-spare]))
    )
    status = flow.solve()
    if status == flow.INFEASIBLE:
        return None
    if status != flow.OPTIMAL:
        raise SolverError(f"min-cost flow ended with status {status.name}")
    choice = np.full(robots, UNASSIGNED)
    used = np.flatnonzero(flow.flows(np.arange(pairs)))
    choice[problem.pair_robot[used]] = problem.pair_demand[used]
    return choice


# Registry
SOLVERS: dict[str, Solver] = {"min_cost_flow": min_cost_flow}
DEFAULT_SOLVER = "min_cost_flow"
