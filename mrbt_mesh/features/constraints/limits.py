"""*Check Consistency* and *Assign Agents* in a mission with side constraints.

A request is kept if it and all requests kept before it stay feasible together *with* the
constraints. This is not a matching problem: CP-SAT decides what a matching cannot. Robots that work
already count, but are not stopped: a constraint restricts only the robots that the plan assigns
beside them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from mrbt_mesh.core.assignment.problem import (
    AssignmentProblem,
    Bounds,
    Limit,
    Shared,
    SideConstraint,
    require_planner,
)
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.feature import Limits
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.consistency import LimitCheck
from mrbt_mesh.core.planning.demands import Demand, running_on
from mrbt_mesh.features.constraints.kinds import AtMost, Constraint, NotAtOnce


class ConstraintLimits(Limits):
    """The limits that the side constraints of a mission set to its plans."""

    name = "side constraints"

    def __init__(self, constraints: Sequence[Constraint]) -> None:
        self._constraints = constraints

    def side_constraints(
        self, free: Sequence[str], wanted: Sequence[Demand], running: Mapping[str, Demand]
    ) -> tuple[SideConstraint, ...]:
        """See `Limits`."""
        return side_constraints(self._constraints, free, wanted, running)

    def check(self, robots: Sequence[str], demands: Sequence[Sequence[Demand]]) -> LimitCheck:
        """See `Limits`."""
        require_planner()
        return SideConstraintCheck(self._constraints, robots, demands)


def side_constraints(
    constraints: Sequence[Constraint],
    free: Sequence[str],
    wanted: Sequence[Demand],
    running: Mapping[str, Demand],
) -> tuple[SideConstraint, ...]:
    """Return what the constraints leave to `free` robots on the `wanted` demands, both by index.

    `running` maps robots to the demands that they work on. Constraints that cannot bind are left
    out.
    """
    able = [
        {index for index, robot in enumerate(free) if robot in demand.candidates}
        for demand in wanted
    ]
    found: list[SideConstraint] = []
    for constraint in constraints:
        if isinstance(constraint, NotAtOnce):
            found += _shared(constraint, wanted, running)
            continue
        members = {index for index, robot in enumerate(free) if robot in constraint.robots}
        if isinstance(constraint, AtMost):
            held = sum(robot in constraint.robots for robot in running)
            who = members & set[int]().union(*able)
            found += _limit(who, range(len(wanted)), constraint.count - held)
            continue
        for number, demand in enumerate(wanted):
            if _names(constraint.local_tasks or (demand.local_task,), demand.local_task):
                same = [running[robot] for robot in constraint.robots if robot in running]
                held = sum(
                    other.request == demand.request and other.local_task == demand.local_task
                    for other in same
                )
                found += _limit(members & able[number], (number,), 1 - held)
    return tuple(found)


def _limit(who: set[int], demands: Sequence[int], count: int) -> list[SideConstraint]:
    count = max(0, count)
    return [Limit(tuple(sorted(who)), tuple(demands), count)] if len(who) > count else []


def _shared(
    constraint: NotAtOnce, wanted: Sequence[Demand], running: Mapping[str, Demand]
) -> list[SideConstraint]:
    served = {
        demand.request.activation
        for demand in running.values()
        if _names(constraint.global_tasks, demand.request.subject)
    }
    groups: dict[str, list[int]] = {}
    for index, demand in enumerate(wanted):
        activation = demand.request.activation
        if activation not in served and _names(constraint.global_tasks, demand.request.subject):
            groups.setdefault(activation, []).append(index)
    count = max(0, constraint.count - len(served))
    if len(groups) <= count:
        return []
    return [Shared(tuple(tuple(group) for group in groups.values()), count)]


def _names(names: Sequence[str], ground: str) -> bool:
    return ground in names or type_name(ground) in names


class SideConstraintCheck(LimitCheck):
    """Keeps requests one after the other while all stay feasible within the constraints.

    `demands` are those of all requests; the robots that run are found in them.
    """

    def __init__(
        self,
        constraints: Sequence[Constraint],
        robots: Sequence[str],
        demands: Sequence[Sequence[Demand]],
    ) -> None:
        self._constraints = constraints
        self._robots = sorted(robots)
        self._demands = demands
        self._kept: list[int] = []

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Try to add request `key`; `pinned` maps robots to the request that they run."""
        fits = self.fits(key, demands, pinned)
        if fits:
            self._kept.append(key)
        return fits

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """True if `keep` would succeed."""
        return self._is_feasible([*self._kept, key], pinned, self._constraints)

    def obstacle(self, demands: Sequence[Demand]) -> str:
        """Return the constraints that prevent any living robots from serving a request.

        Empty if none do.
        """
        alone = SideConstraintCheck(self._constraints, self._robots, [demands])
        return alone.in_the_way([], 0, {})

    def in_the_way(self, kept: Sequence[int], key: int, pinned: Mapping[str, int]) -> str:
        """Return the constraints that keep request `key` from being kept with others.

        These are the constraints that would do so alone; if none would, all that bind. Empty if the
        constraints are not the obstacle.
        """
        keys = sorted({*kept, key})
        if not self._is_feasible(keys, pinned, ()):
            return ""
        if self._is_feasible(keys, pinned, self._constraints):
            return ""
        binding = [c for c in self._constraints if self._problem(keys, pinned, [c]).constraints]
        alone = [c for c in binding if not self._is_feasible(keys, pinned, [c])]
        return "; ".join(str(constraint) for constraint in alone or binding)

    def _problem(
        self, keys: Sequence[int], pinned: Mapping[str, int], constraints: Sequence[Constraint]
    ) -> AssignmentProblem:
        """Return the problem with the lower bounds still to be met.

        If these are infeasible, so are larger numbers of robots.
        """
        wanted, bounds = [], []
        for key in keys:
            for demand in self._demands[key]:
                needed = demand.lower - sum(pinned.get(robot) == key for robot in demand.pinned)
                if needed > 0:
                    wanted.append(demand)
                    bounds.append(Bounds(demand.local_task, needed, needed))
        free = [robot for robot in self._robots if robot not in pinned]
        rows = [{i: 0 for i, d in enumerate(wanted) if robot in d.candidates} for robot in free]
        running = running_on(self._demands, pinned)
        limits = side_constraints(constraints, free, wanted, running)
        return AssignmentProblem.of(free, bounds, rows, limits)

    def _is_feasible(
        self, keys: Sequence[int], pinned: Mapping[str, int], constraints: Sequence[Constraint]
    ) -> bool:
        problem = self._problem(keys, pinned, constraints)
        if not problem.demands:
            return True
        found = min_cost_flow(replace(problem, constraints=()))
        if found is None:
            return False
        if problem.violated(found.tolist()) is None:
            return True
        # Imported when the robot started, since the library is large.
        from mrbt_mesh.core.assignment.cp_sat import is_feasible

        return is_feasible(problem)
