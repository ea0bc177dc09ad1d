"""What a solver has answered: whether it is an assignment, and keeps the bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrbt_mesh.core.assignment.problem import (
    UNASSIGNED,
    AssignmentProblem,
    Integers,
    SolverError,
)


def checked(
    problem: AssignmentProblem, answer: Sequence[int] | Integers
) -> tuple[Integers, Integers, Integers]:
    """An assignment that keeps the bounds: choice, counts (as in ProvenOptimum), chosen options.

    Raises SolverError if it does not keep them, or is no assignment at all.
    """
    idle, given = len(problem.demands), _as_integers(answer)
    if len(given) != len(problem.robots):
        raise SolverError(f"{len(given)} answers for {len(problem.robots)} robots")
    unassigned = (given == UNASSIGNED).nonzero()[0]
    choice = given.copy()
    choice[unassigned] = idle
    robots, nodes, _ = problem.options
    chosen = (choice[robots] == nodes).nonzero()[0]
    # Whatever is out of range, or cannot be done, is no option.
    if len(chosen) != len(choice):
        raise _impossible(problem, given)
    counts = np.bincount(choice, minlength=idle + 1)
    if counts[idle] != len(unassigned):  # idle goes by another number in answers
        raise _impossible(problem, given)
    wrong = (counts < problem.lower) | (counts > problem.upper)
    if np.count_nonzero(wrong):
        demand = int(wrong.argmax())
        bounds = problem.demands[demand]
        count = counts[demand]
        raise SolverError(f"{count} robots on {bounds.id}, {bounds.lower}..{bounds.upper}")
    return choice, counts, chosen


def _as_integers(answer: Sequence[int] | Integers) -> Integers:
    """What a solver returned, which may be anything. Raises SolverError if it is no answer."""
    try:
        given = np.asarray(answer)
        if given.ndim == 1 and (given.dtype.kind == "i" or not len(given)):
            return given.astype(np.int64, copy=False)
    except (ValueError, TypeError, OverflowError):
        pass  # not even an array
    shown = repr(answer)
    raise SolverError(f"one whole number per robot is expected, it returned {shown:.80}")


def _impossible(problem: AssignmentProblem, given: Integers) -> SolverError:
    for name, performance, demand in zip(
        problem.robots, problem.performance, given.tolist(), strict=True
    ):
        if demand != UNASSIGNED and not 0 <= demand < len(problem.demands):
            return SolverError(f"{name}: no demand {demand}")
        if demand != UNASSIGNED and demand not in performance:
            return SolverError(f"{name} cannot do {problem.demands[demand].id}")
    return SolverError("a robot and a demand are paired twice")
