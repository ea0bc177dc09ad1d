"""The project's own assignment, as the benchmarks ask for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.instances import Instance
from mrbt_mesh.core.assignment.canonical import solve
from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.problem import UNASSIGNED, AssignmentProblem, Bounds
from mrbt_mesh.core.assignment.solve import FEW, of_few
from mrbt_mesh.core.assignment.solvers import default_solver


def prepare(instance: Instance) -> AssignmentProblem | NamedProblem:
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


def answer(problem: AssignmentProblem | NamedProblem) -> NDArray[np.int64]:
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
