"""How a new incarnation joins: it listens and catches up before it claims anything.

Otherwise the first process up would agree with itself and start, and one that was replaced
while it slept would carry on with stale facts.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mrbt_mesh.core.membership import State
from mrbt_mesh.core.timing import Timing


class Joining:
    """Done when facts were exchanged with every peer that is heard, and either all expected
    robots were heard or one detection time has passed.

    `first`: the process has just started (not: it fenced itself). `foreign` is why the last
    incompatible message was refused.
    """

    def __init__(
        self, timing: Timing, expected: frozenset[str], now_us: int, first: bool = True
    ) -> None:
        self.deadline_us = now_us + timing.detection_us
        self.first = first
        self.foreign = ""
        self._expected = expected
        self._heard: set[str] = set()
        self._exchanged: set[str] = set()

    def heard(self, robot: str) -> None:
        """A beat of `robot` itself arrived."""
        self._heard.add(robot)

    def exchanged(self, robot: str) -> None:
        """`robot` has answered with its facts."""
        self._exchanged.add(robot)

    def has_asked(self, robots: Collection[str]) -> bool:
        """Whether all of these have answered with their facts."""
        return self._exchanged.issuperset(robots)

    def wants(self, robot: str, state: State) -> bool:
        """Whether the facts of this robot are still needed."""
        present = state in (State.ALIVE, State.SUSPECT)
        return present and robot in self._heard and robot not in self._exchanged

    def is_done(self, states: Mapping[str, State], awaited: bool, now_us: int) -> bool:
        """Whether the robot may take its place in the team.

        `awaited`: others still count an earlier life of this robot among the living; they are
        given the time to notice.
        """
        if any(self.wants(robot, state) for robot, state in states.items()):
            return False
        if now_us >= self.deadline_us:
            return True
        return self._expected <= self._heard and not awaited
