"""The assignment problem given to each solver that one would use.

All but ours return some optimum, as they find it. Each takes what `prepare` made of the instance
(for all but ours the instance itself) and a time limit, and returns a demand, or -1, per robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.instances import Instance
from benchmarks.registry import need
from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.problem import UNASSIGNED, AssignmentProblem, Bounds
from mrbt_mesh.core.assignment.solve import FEW, of_few
from mrbt_mesh.core.assignment.solvers import default_solver


class TimeLimitError(Exception):
    """A solver was not done in time."""


@dataclass(frozen=True)
class Solver:
    """`prepare` is not timed: it is the form in which the problem is at hand. `needs`: a module
    of the package it comes with. `limited`: it keeps to its time limit."""

    label: str
    solve: Callable[[Any, float], NDArray[np.int64]]
    needs: str
    prepare: Callable[[Instance], Any] = lambda instance: instance
    limited: bool = False


def min_cost_flow(instance: Instance, limit_s: float) -> NDArray[np.int64]:
    """OR-tools' min-cost flow, arcs in bulk: the reference."""
    module = need("ortools.graph.python.min_cost_flow")
    robots, demands = instance.robots, instance.demands
    pool = robots + demands
    nodes = np.arange(robots + demands, dtype=np.int64)
    tails = np.concatenate([instance.robot, nodes])
    heads = np.concatenate([instance.demand + robots, np.full(robots + demands, pool)])
    ones = np.ones(instance.pairs + robots, dtype=np.int64)
    capacities = np.concatenate([ones, instance.upper - instance.lower])
    costs = np.concatenate([-instance.performance, np.zeros(robots + demands, dtype=np.int64)])
    supplies = np.ones(pool + 1, dtype=np.int64)
    supplies[robots:pool] = -instance.lower
    supplies[pool] = int(instance.lower.sum()) - robots
    flow = module.SimpleMinCostFlow()
    arcs = flow.add_arcs_with_capacity_and_unit_cost(tails, heads, capacities, costs)
    flow.set_nodes_supplies(np.arange(pool + 1), supplies)
    if flow.solve() != flow.OPTIMAL:
        raise ValueError("min-cost flow found no optimum")
    return _choice(instance, flow.flows(arcs[: instance.pairs]) > 0)


def _choice(instance: Instance, taken: NDArray[np.bool_]) -> NDArray[np.int64]:
    choice = np.full(instance.robots, -1, dtype=np.int64)
    choice[instance.robot[taken]] = instance.demand[taken]
    return choice


def cp_sat(instance: Instance, limit_s: float) -> NDArray[np.int64]:
    """CP-SAT, one worker, linearization_level=2: far better here than its defaults."""
    cp_model = need("ortools.sat.python.cp_model")
    model = cp_model.CpModel()
    variables = [model.new_bool_var("") for _ in range(instance.pairs)]
    of_robot: list[list[Any]] = [[] for _ in range(instance.robots)]
    of_demand: list[list[Any]] = [[] for _ in range(instance.demands)]
    pairs = zip(variables, instance.robot.tolist(), instance.demand.tolist(), strict=True)
    for variable, robot, demand in pairs:
        of_robot[robot].append(variable)
        of_demand[demand].append(variable)
    for own in of_robot:
        model.add_at_most_one(own)
    for own, lower, upper in zip(of_demand, instance.lower, instance.upper, strict=True):
        model.add_linear_constraint(cp_model.LinearExpr.sum(own), int(lower), int(upper))
    weights = instance.performance.tolist()
    model.maximize(cp_model.LinearExpr.weighted_sum(variables, weights))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.linearization_level = 2
    solver.parameters.max_time_in_seconds = limit_s
    if solver.solve(model) != cp_model.OPTIMAL:
        raise TimeLimitError
    return _choice(instance, np.array(solver.values(variables), dtype=np.bool_))


def milp(instance: Instance, limit_s: float) -> NDArray[np.int64]:
    """SciPy's `milp`, which is HiGHS, on a sparse matrix."""
    optimize, sparse = need("scipy.optimize"), need("scipy.sparse")
    pairs = instance.pairs
    rows = np.concatenate([instance.robot, instance.demand + instance.robots])
    columns = np.tile(np.arange(pairs), 2)
    matrix = sparse.csc_array(
        (np.ones(2 * pairs), (rows, columns)), shape=(instance.robots + instance.demands, pairs)
    )
    low = np.concatenate([np.zeros(instance.robots), instance.lower])
    high = np.concatenate([np.ones(instance.robots), instance.upper])
    found = optimize.milp(
        -instance.performance.astype(np.float64),
        integrality=np.ones(pairs),
        bounds=optimize.Bounds(0, 1),
        constraints=optimize.LinearConstraint(matrix, low, high),
        options={"time_limit": limit_s, "mip_rel_gap": 0.0},
    )
    if found.status != 0:
        raise TimeLimitError
    return _choice(instance, found.x > 0.5)


def linear_sum_assignment(instance: Instance, limit_s: float) -> NDArray[np.int64]:
    """SciPy's `linear_sum_assignment`: a column per robot that a demand may take.

    The first nu columns of a demand get a bonus beyond any sum of performances, which makes
    lower bounds come first; a robot that ends in a column of value 0 stays idle.
    """
    optimize = need("scipy.optimize")
    demand, needed = instance.slots()
    bonus = instance.robots * int(instance.performance.max(initial=0)) + 1
    values = instance.matrix()[:, demand].astype(np.float64)
    values[:, needed] += bonus * (values[:, needed] > 0)
    robots, columns = optimize.linear_sum_assignment(values, maximize=True)
    able = values[robots, columns] > 0
    choice = np.full(instance.robots, -1, dtype=np.int64)
    choice[robots[able]] = demand[columns[able]]
    return choice


def prepare_ours(instance: Instance) -> AssignmentProblem | NamedProblem:
    """The problem in the form in which the planner has it; not a part of what is timed."""
    robots = tuple(f"R{robot:05}" for robot in range(instance.robots))
    names = [f"D{index:05}" for index in range(instance.demands)]
    bounds = list(zip(names, instance.lower.tolist(), instance.upper.tolist(), strict=True))
    columns = (instance.robot, instance.demand, instance.performance)
    if len(robots) * len(names) > FEW:
        return AssignmentProblem(robots, tuple(Bounds(*each) for each in bounds), *columns)
    candidates: list[dict[str, int]] = [{} for _ in names]
    for robot, demand, performance in zip(*(each.tolist() for each in columns), strict=True):
        candidates[demand][robots[robot]] = performance
    offered = (NamedDemand(*each, some) for each, some in zip(bounds, candidates, strict=True))
    return NamedProblem(robots, tuple(offered))


def answer_ours(problem: AssignmentProblem | NamedProblem) -> NDArray[np.int64]:
    """The exact and canonical optimum: a demand, or -1, per robot."""
    if isinstance(problem, NamedProblem):
        found = of_few(problem)
        if found is not None:
            number = {demand.id: index for index, demand in enumerate(problem.demands)}
            number[""] = UNASSIGNED
            return np.array([number[found.get(robot, "")] for robot in problem.robots])
    elif (choice := solve(problem, default_solver)) is not None:
        return np.array(choice, dtype=np.int64)
    raise ValueError("infeasible")


def ours_canonical(problem: Any, limit_s: float) -> NDArray[np.int64]:
    """The project's whole answer, exact and canonical."""
    return answer_ours(replace(problem))  # without what an earlier call has kept in it


REFERENCE = "min_cost_flow"
OURS = "ours"

SOLVERS = {
    REFERENCE: Solver("OR-tools min-cost flow", min_cost_flow, "ortools"),
    OURS: Solver("ours, canonical", ours_canonical, "ortools", prepare_ours),
    "cp_sat": Solver("CP-SAT", cp_sat, "ortools.sat.python.cp_model", limited=True),
    "milp": Solver("HiGHS milp", milp, "scipy.optimize", limited=True),
    "linear_sum_assignment": Solver("LSA on slots", linear_sum_assignment, "scipy.optimize"),
}
