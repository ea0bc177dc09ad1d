"""Assignment problems by names, and what is different between one and the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import is_

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
    """An assignment problem by ids: robots sorted, demands in order of preference."""

    robots: tuple[str, ...]
    demands: tuple[NamedDemand, ...]

    def is_same(self, other: NamedProblem) -> bool:
        """Whether these are the same demands, as objects, and robots of the same names."""
        return (
            len(self.demands) == len(other.demands)
            and all(map(is_, self.demands, other.demands))
            and self.robots == other.robots
        )

    def problem(self) -> AssignmentProblem:
        """The same by indices, as solvers take it."""
        number = {robot: index for index, robot in enumerate(self.robots)}
        pairs = [
            (number[robot], index, performance)
            for index, demand in enumerate(self.demands)
            for robot, performance in demand.candidates.items()
            if robot in number
        ]
        pairs.sort()
        bounds = tuple(Bounds(d.id, d.lower, d.upper) for d in self.demands)
        columns = zip(*pairs, strict=True) if pairs else ((), (), ())
        robots, demands, performances = map(integers, columns)
        return AssignmentProblem(self.robots, bounds, robots, demands, performances)
