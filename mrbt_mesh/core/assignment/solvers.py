"""The project's own solvers of the assignment problem.

A solver is a function from AssignmentProblem to any optimum; the canonical pass does the rest. How
users add theirs is in docs/how-to/constraints.md; `runtime.solver_loader` finds all by name.
"""

from __future__ import annotations

from mrbt_mesh.core.assignment.problem import (
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
    Raises SolverError for a problem with side constraints: they have no such form.
    """
    # Loaded for large problems alone.
    import numpy as np
    from ortools.graph.python.min_cost_flow import SimpleMinCostFlow

    if problem.constraints:
        raise SolverError("min_cost_flow knows no side constraints: use cp_sat")
    robots, demands, pairs = len(problem.robots), len(problem.demands), len(problem.pair_robot)
    pool = robots + demands
    spare = robots - int(problem.lower.sum())
    if spare < 0:
        return None
    # The node after the last demand is the pool.
    tails, heads, performances = problem.options
    nodes = np.arange(pool + 1)
    capacities = np.ones(len(tails) + demands, np.int64)
    np.subtract(problem.upper[:-1], problem.lower[:-1], out=capacities[len(tails) :])
    supplies = np.ones(pool + 1, np.int64)
    np.negative(problem.lower[:-1], out=supplies[robots:pool])
    supplies[pool] = -spare
    # Cost scaling takes a round for each digit: micro-units are often far finer than the values.
    unit = np.gcd.reduce(performances)
    gains = performances // unit if unit > 1 else performances
    flow = SimpleMinCostFlow()
    arcs = flow.add_arcs_with_capacity_and_unit_cost(
        np.concatenate((tails, nodes[robots:pool])),
        np.concatenate((heads + robots, np.full(demands, pool))),
        capacities,
        np.concatenate((-gains, np.zeros(demands, np.int64))),
    )
    flow.set_nodes_supplies(nodes, supplies)
    status = flow.solve()
    if status == flow.INFEASIBLE:
        return None
    if status != flow.OPTIMAL:
        raise SolverError(f"min-cost flow ended with status {status.name}")
    choice = np.full(robots, UNASSIGNED)
    used = np.flatnonzero(flow.flows(arcs[:pairs]))
    choice[problem.pair_robot[used]] = problem.pair_demand[used]
    return choice


def cp_sat(problem: AssignmentProblem) -> list[int] | None:
    """Solve with OR-tools' CP-SAT, one worker; minds side constraints. Exact, or SolverError."""
    # Loaded here: the library is large, and takes a second to load.
    from mrbt_mesh.core.assignment import cp_sat as model

    return model.optimum(problem)


cp_sat.supports_constraints = True  # type: ignore[attr-defined]


def default_solver(problem: AssignmentProblem) -> Integers | list[int] | None:
    """What is used where no solver is named: min_cost_flow, or cp_sat for side constraints."""
    return cp_sat(problem) if problem.constraints else min_cost_flow(problem)


default_solver.supports_constraints = True  # type: ignore[attr-defined]

SOLVERS: dict[str, Solver] = {
    "min_cost_flow": min_cost_flow,
    "cp_sat": cp_sat,
}
