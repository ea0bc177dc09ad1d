"""*Assign Agents* again and again: the canonical optimum of each problem from that of the last.

The answer is the same as from scratch, always; what differs is the time it takes. Small teams and
many changes at once are solved from scratch, and so is what turns out to reach far.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias

from mrbt_mesh.core.assignment.named import NamedProblem
from mrbt_mesh.core.incremental.assignment.problem_changes import ProblemChanges, difference

if TYPE_CHECKING:
    from mrbt_mesh.core.incremental.assignment.optimum import Optimum

# The canonical optimum: robot -> demand, without the idle robots; None: infeasible.
FromScratch: TypeAlias = Callable[[NamedProblem], dict[str, str] | None]

# Teams from which on a change is faster than solving again: benchmarks/incremental.py.
SMALLEST_TEAM = 50
# So many robots per change: with more changes at once, solving again is faster.
ROBOTS_PER_CHANGE = 25
# Visits of nodes in one update that cost less than solving again: so many robots per visit, or so
# many pairs of a robot and a demand that it can do, whichever allows more.
ROBOTS_PER_VISIT, PAIRS_PER_VISIT = 1, 100
# Small changes that are solved from scratch after an update that turned out to reach too far: this
# many, then twice as many and so on.
FIRST_PAUSE, LONGEST_PAUSE = 3, 63


class Reassigner:
    """Keeps the last problem and its optimum."""

    def __init__(self, from_scratch: FromScratch, smallest_team: int = SMALLEST_TEAM) -> None:
        self._from_scratch = from_scratch
        self._smallest_team = smallest_team
        self._team = NamedProblem((), ())
        self._assigned: dict[str, str] | None = {}
        self._optimum: Optimum | None = None
        self._pause = 0
        self._small_changes = 0

    def update(self, team: NamedProblem) -> Mapping[str, str] | None:
        """Robot -> demand, without the idle robots, in no order; None if infeasible.

        A view, of this problem until the next update.
        """
        if team.is_same(self._team):
            return None if self._assigned is None else MappingProxyType(self._assigned)
        changes = self._small_difference(team)
        if changes is None:
            self._small_changes = 0
            self._solve(team)
        elif not self._is_ready():
            self._small_changes += 1
            self._solve(team)
        else:
            self._apply(changes, team)
        return None if self._assigned is None else MappingProxyType(self._assigned)

    def prepare(self) -> None:
        """Work the prices out now, if the next update is likely to need them.

        That takes as long as one or two solutions. Otherwise it is done in the second update in a
        row that is small.
        """
        large = len(self._team.robots) >= self._smallest_team
        if self._optimum is not None or not large or self._small_changes < self._pause:
            return
        if self._assigned is not None:
            # For large teams: it loads numpy.
            from mrbt_mesh.core.incremental.assignment.optimum import Optimum

            self._optimum = Optimum(self._team, self._assigned)

    def _small_difference(self, team: NamedProblem) -> ProblemChanges | None:
        if self._assigned is None or len(team.robots) < self._smallest_team:
            return None
        changes = difference(self._team, team)
        few = changes is not None and len(changes) * ROBOTS_PER_CHANGE <= len(team.robots)
        return changes if few else None

    def _is_ready(self) -> bool:
        if self._small_changes:
            self.prepare()
        return self._optimum is not None

    def _solve(self, team: NamedProblem) -> None:
        assigned = self._from_scratch(team)  # may raise: nothing has changed by then
        self._team, self._optimum, self._assigned = team, None, assigned

    def _apply(self, changes: ProblemChanges, team: NamedProblem) -> None:
        from mrbt_mesh.core.incremental.assignment.residual import InfeasibleError, TooFarError

        optimum, self._optimum = self._optimum, None
        assert optimum is not None
        visits = max(len(team.robots) // ROBOTS_PER_VISIT, optimum.pairs // PAIRS_PER_VISIT)
        try:
            optimum.apply(changes, visits)
        except InfeasibleError:
            self._team, self._assigned = team, None
        except TooFarError:
            self._pause = min(2 * self._pause + FIRST_PAUSE, LONGEST_PAUSE)
            self._small_changes = 0
            self._solve(team)
        else:
            self._pause //= 2
            self._team, self._optimum, self._assigned = team, optimum, optimum.assigned
