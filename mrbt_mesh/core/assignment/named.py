"""Assignment problems by names, and what is different between one and the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mrbt_mesh.core.assignment.problem import AssignmentProblem, Bounds, integers


@dataclass(frozen=True, slots=True)
class NamedDemand:
    """A demand: between `lower` and `upper` robots; performance per candidate, in micro-units.

    Candidates that are not in the team do not count.
    """

    id: str
    lower: int
    upper: int
    candidates: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class NamedProblem:
    """An assignment problem by ids: robots and demands in order of preference."""

    robots: tuple[str, ...]
    demands: tuple[NamedDemand, ...]

    def problem(self) -> AssignmentProblem:
        """The same by indices, as solvers take it."""
        import numpy as np  # small teams never need it

        number = {robot: index for index, robot in enumerate(self.robots)}
        # A demand may have far more candidates than there are robots, most of them at work.
        candidates = [
            some if len(some) <= len(number) else {r: some[r] for r in number if r in some}
            for some in (demand.candidates for demand in self.demands)
        ]
        robots = integers(number.get(robot, -1) for some in candidates for robot in some)
        demands = np.repeat(np.arange(len(candidates)), [len(some) for some in candidates])
        performances = integers(value for some in candidates for value in some.values())
        # By robot, then demand; those that are not in the team come first and are left out.
        order = robots.argsort(kind="stable")[np.count_nonzero(robots < 0) :]
        bounds = tuple(Bounds(d.id, d.lower, d.upper) for d in self.demands)
        pairs = robots[order], demands[order], performances[order]
        return AssignmentProblem(self.robots, bounds, *pairs)
