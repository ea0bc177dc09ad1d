"""Solvers of the assignment problem. `SOLVERS` is where a user's own one is registered.

A solver is a function from AssignmentProblem to any optimum; the canonical pass does the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

from ortools.graph.python.min_cost_flow import SimpleMinCostFlow

from mrbt_mesh.core.assignment import UNASSIGNED, AssignmentProblem, Solver, SolverError


def min_cost_flow(problem: AssignmentProblem) -> Sequence[int] | None:
    """Solve as a transportation problem with OR-tools' min-cost flow; polynomial and exact.

    Every robot sends one unit to a demand or to the pool. A demand keeps its lower bound and
    passes up to (upper - lower) on to the pool, so that feasibility needs no penalty cost.
    """
    robots, demands = len(problem.robots), problem.demands
    pool = robots + len(demands)
    spare = robots - sum(bounds.lower for bounds in demands)
    if spare < 0:
        return None
    flow = SimpleMinCostFlow()
    arcs: list[tuple[int, int]] = []
    for robot, performance in enumerate(problem.performance):
        for demand in sorted(performance):
            flow.add_arc_with_capacity_and_unit_cost(
                robot, robots + demand, 1, -performance[demand]
            )
            arcs.append((robot, demand))
        flow.add_arc_with_capacity_and_unit_cost(robot, pool, 1, 0)
        arcs.append((robot, UNASSIGNED))
        flow.set_node_supply(robot, 1)
    for demand, bounds in enumerate(demands):
        flow.add_arc_with_capacity_and_unit_cost(
            robots + demand, pool, bounds.upper - bounds.lower, 0
        )
        flow.set_node_supply(robots + demand, -bounds.lower)
    flow.set_node_supply(pool, -spare)
    status = flow.solve()
    if status == flow.INFEASIBLE:
        return None
    if status != flow.OPTIMAL:
        raise SolverError(f"min-cost flow ended with status {status.name}")
    choice = [UNASSIGNED] * robots
    for arc, (robot, demand) in enumerate(arcs):
        if flow.flow(arc):
            choice[robot] = demand
    return choice


# Registry
SOLVERS: dict[str, Solver] = {"min_cost_flow": min_cost_flow}
DEFAULT_SOLVER = "min_cost_flow"
