"""The assignment that every solver has to lead to, by trying out all of them."""

from __future__ import annotations

import math

from mrbt_mesh.core.assignment.problem import UNASSIGNED, AssignmentProblem

MAX_CHOICES = 200_000


def brute_force(problem: AssignmentProblem) -> tuple[int, ...] | None:
    """The canonical optimum of a small problem, in the order that the rule names."""
    choices = math.prod(len(options) + 1 for options in problem.performance)
    assert choices <= MAX_CHOICES, f"{choices:,} combinations would take too long"
    demands, count = problem.demands, len(problem.robots)
    counts = [0] * len(demands)
    options = [
        [*((d, p[d]) for d in sorted(p)), (UNASSIGNED, 0)] for p in map(dict, problem.performance)
    ]
    best: tuple[int, tuple[int, ...]] | None = None
    choice = [UNASSIGNED] * count

    def go(robot: int, total: int) -> None:
        nonlocal best
        if robot == count:
            fits = all(n >= demand.lower for n, demand in zip(counts, demands, strict=True))
            better = fits and (best is None or total > best[0])
            if better and problem.violated(choice) is None:
                best = total, tuple(choice)
            return
        for demand, value in options[robot]:
            if demand == UNASSIGNED:
                choice[robot] = UNASSIGNED
                go(robot + 1, total)
            elif counts[demand] < demands[demand].upper:
                counts[demand] += 1
                choice[robot] = demand
                go(robot + 1, total + value)
                counts[demand] -= 1

    go(0, 0)
    return None if best is None else best[1]


brute_force.supports_constraints = True  # type: ignore[attr-defined]
