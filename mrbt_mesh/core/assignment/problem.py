"""*Assign Agents*: the paper's problem (2).

Maximise the sum of p(i, l) r(i, l) within the bounds of each demand, at most one demand per
robot, in integers. A solver finds some optimum (`solvers`), which `canonical.solve` turns into
the one that the order of robots and demands names. Side constraints, as the paper's
r(i, j) r(h, j) = 0, are limits on which robots may be assigned together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

from mrbt_mesh.errors import InputError, require

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

UNASSIGNED = -1
PLANNER = "planner"
PLANNER_MODULES = ("numpy", "ortools")

Integers: TypeAlias = "npt.NDArray[np.int64]"


@dataclass(frozen=True, slots=True)
class Bounds:
    """One demand: between `lower` and `upper` robots."""

    id: str
    lower: int
    upper: int


@dataclass(frozen=True, slots=True)
class Limit:
    """At most `count` of these robots on these demands, counted together. Both are indices."""

    robots: tuple[int, ...]
    demands: tuple[int, ...]
    count: int


@dataclass(frozen=True, slots=True)
class Shared:
    """At most `count` of these groups of demands have any robot. Groups are indices, disjoint."""

    groups: tuple[tuple[int, ...], ...]
    count: int


SideConstraint: TypeAlias = Limit | Shared


def require_planner(what: str = "planning by min-cost flow or CP-SAT") -> None:
    """Raise MissingExtraError unless the libraries of large and constrained problems are there."""
    require(what, PLANNER, *PLANNER_MODULES)


def integers(values: Iterable[int]) -> Integers:
    """As an array of 64-bit integers."""
    import numpy as np  # small teams never need it

    return np.fromiter(values, np.int64)


@dataclass(frozen=True, eq=False)
class AssignmentProblem:
    """Robots and demands in order of preference, and performances.

    `pair_robot`, `pair_demand` and `pair_performance` are arrays of equal length, one entry per
    robot and demand that it can do, ordered by robot, then demand: their indices, and p in
    micro-units, below 2^60 divided by the number of robots and demands. Absent: cannot. The
    arrays cannot be written to: a solver that changed them would be checked against its changes.
    """

    robots: tuple[str, ...]
    demands: tuple[Bounds, ...]
    pair_robot: Integers
    pair_demand: Integers
    pair_performance: Integers
    constraints: tuple[SideConstraint, ...] = ()

    def __post_init__(self) -> None:
        for pairs in (self.pair_robot, self.pair_demand, self.pair_performance):
            pairs.setflags(write=False)

    @classmethod
    def of(
        cls,
        robots: Iterable[str],
        demands: Iterable[Bounds],
        performance: Iterable[Mapping[int, int]],
        constraints: Iterable[SideConstraint] = (),
    ) -> AssignmentProblem:
        """From one mapping per robot, from a demand's index to p."""
        rows = [sorted(row.items()) for row in performance]
        return cls(
            tuple(robots),
            tuple(demands),
            integers(robot for robot, row in enumerate(rows) for _ in row),
            integers(demand for row in rows for demand, _ in row),
            integers(value for row in rows for _, value in row),
            tuple(constraints),
        )

    @cached_property
    def options(self) -> tuple[Integers, Integers, Integers]:
        """The pairs, then every robot without a demand: robot, node, performance.

        That is the node after the last demand; its performance is 0.
        """
        import numpy as np

        count = len(self.robots)
        idle = np.empty(count, np.int64)
        idle.fill(len(self.demands))
        return (
            np.concatenate((self.pair_robot, np.arange(count))),
            np.concatenate((self.pair_demand, idle)),
            np.concatenate((self.pair_performance, np.zeros(count, np.int64))),
        )

    @cached_property
    def lower(self) -> Integers:
        """The lower bounds, per demand, and at last that of the robots without any."""
        return integers([*[bounds.lower for bounds in self.demands], 0])

    @cached_property
    def upper(self) -> Integers:
        """The upper bounds likewise; no number of robots without a demand is too large."""
        return integers([*[bounds.upper for bounds in self.demands], len(self.robots) + 1])

    @cached_property
    def performance(self) -> tuple[Mapping[int, int], ...]:
        """Per robot, from a demand's index to p."""
        rows: list[dict[int, int]] = [{} for _ in self.robots]
        pairs = (self.pair_robot, self.pair_demand, self.pair_performance)
        for robot, demand, value in zip(*(pair.tolist() for pair in pairs), strict=True):
            rows[robot][demand] = value
        return tuple(rows)

    def objective(self, choice: Sequence[int]) -> int:
        """The sum of performances of an assignment, in micro-units."""
        return sum(self.performance[i][d] for i, d in enumerate(choice) if d != UNASSIGNED)

    def violated(self, choice: Sequence[int]) -> SideConstraint | None:
        """The first side constraint that an assignment breaks, None if it keeps them all."""
        for constraint in self.constraints:
            if isinstance(constraint, Limit):
                count = sum(choice[robot] in constraint.demands for robot in constraint.robots)
            else:
                used = set(choice)
                count = sum(not used.isdisjoint(group) for group in constraint.groups)
            if count > constraint.count:
                return constraint
        return None


# A solver returns one demand index per robot (UNASSIGNED for none), or None if infeasible.
# One that respects `problem.constraints` has `solver.supports_constraints = True`.
Solver: TypeAlias = "Callable[[AssignmentProblem], Sequence[int] | Integers | None]"


class SolverError(InputError):
    """A solver broke its contract, or cannot solve this problem; see the message."""


def supports_constraints(solver: Solver) -> bool:
    """Whether a solver minds side constraints."""
    return getattr(solver, "supports_constraints", False) is True
