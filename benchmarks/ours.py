"""The project's own assignment, as the benchmarks ask for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.instances import Instance
from mrbt_mesh.core.assignment import AssignmentProblem, Bounds
from mrbt_mesh.core.canonical import solve
from mrbt_mesh.core.solvers import default_solver


def prepare(instance: Instance) -> AssignmentProblem:
    """The problem as the planner hands it over; not a part of what is timed."""
    robots = tuple(f"R{robot:05}" for robot in range(instance.robots))
    demands = tuple(
        Bounds(f"D{index:05}", lower, upper)
        for index, (lower, upper) in enumerate(
            zip(instance.lower.tolist(), instance.upper.tolist(), strict=True)
        )
    )
    pairs = (instance.robot, instance.demand, instance.performance)
    return AssignmentProblem(robots, demands, *pairs)


def answer(problem: AssignmentProblem) -> NDArray[np.int64]:
    """The exact and canonical optimum: a demand, or -1, per robot."""
    found = solve(problem, default_solver)
    if found is None:
        raise ValueError("infeasible")
    return np.array(found, dtype=np.int64)
