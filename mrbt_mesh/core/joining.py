"""How a new incarnation joins: it listens and catches up before it claims anything.

Otherwise the first process up would agree with itself and start, and one that was replaced
while it slept would carry on with stale facts.
"""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.membership import State
from mrbt_mesh.core.timing import Timing


class Joining:
    """Done when facts were exchanged with every peer that is heard, and either all expected
    robots were heard or one detection time has passed. While others still count an earlier
    incarnation of this robot among the living, it waits for them to notice, too.

    `first`: the process has just started (not: it fenced itself). `rival` is the highest
    incarnation counter heard under this robot's own id, `foreign` why the last incompatible
    message was refused.
    """

    def __init__(
        self, timing: Timing, expected: frozenset[str], now_us: int, first: bool = True
    ) -> None:
        self.deadline_us = now_us + timing.detection_us
        self.first = first
        self.rival = 0
        self.foreign = ""
        self._patience_us = 3 * timing.beat_us
        self._expected = expected
        self._relayed_us: int | None = None
        self._relayed_number = 0
        self._relayed_by: set[str] = set()
        self._heard: set[str] = set()
        self._exchanged: set[str] = set()

    def heard(self, robot: str) -> None:
        """A beat of `robot` itself arrived."""
        self._heard.add(robot)

    def exchanged(self, robot: str) -> None:
        """`robot` has answered with its facts."""
        self._exchanged.add(robot)

    def relayed(self, source: str, number: int | None, now_us: int) -> bool:
        """What the beat of `source` says of this robot's id: its beat `number`, None for nothing.

        True if somebody else lives under the id: its beats still grow in number after all that
        was on its way must have arrived.
        """
        if number is None:
            self._relayed_by.discard(source)
            return False
        self._relayed_by.add(source)
        if self._relayed_us is None:
            self._relayed_us = now_us
        grown = number > self._relayed_number
        self._relayed_number = max(self._relayed_number, number)
        return grown and now_us >= self._relayed_us + self._patience_us

    def wants(self, robot: str, state: State) -> bool:
        """Whether the facts of this robot are still needed."""
        present = state in (State.ALIVE, State.SUSPECT)
        return present and robot in self._heard and robot not in self._exchanged

    def is_done(self, states: Mapping[str, State], now_us: int) -> bool:
        """Whether the robot may take its place in the team."""
        if any(self.wants(robot, state) for robot, state in states.items()):
            return False
        if now_us >= self.deadline_us:
            return True
        return self._expected <= self._heard and not self._relayed_by
