"""How a new incarnation joins: it listens and catches up before it claims anything.

Otherwise the first process up would agree with itself and start, and one that was replaced
while it slept would carry on with stale facts. Facts are exchanged with a peer once it has
answered or, after another one has, tells the same digest: what it wrote may come from others.
One that never answers, since it does not hear the newcomer, holds it up for the longest
detection time.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mrbt_mesh.core.membership.peer import Peer
from mrbt_mesh.core.membership.timing import Timing


class Joining:
    """Done when facts were exchanged with every peer that is heard, and either all expected
    robots were heard or one detection time has passed.

    `is_first`: the process has just started (not: it fenced itself). `refusal` is why the last
    incompatible message was refused. `gather_us`: while nobody has joined yet, the expected
    robots are waited for so long, if that is longer: how long processes take to start has
    nothing to do with how soon a silent one is dead.
    """

    def __init__(
        self,
        timing: Timing,
        expected: frozenset[str],
        now_us: int,
        is_first: bool = True,
        gather_us: int = 0,
    ) -> None:
        self.deadline_us = now_us + timing.detection_us
        self.gathers_until_us = max(self.deadline_us, now_us + gather_us)
        self._patient_until_us = now_us + timing.max_silence_us
        self.is_first = is_first
        self.refusal = ""
        self._expected = expected
        self._heard: set[str] = set()
        self._exchanged: set[str] = set()

    def mark_heard(self, robot: str) -> None:
        """A beat of `robot` itself arrived."""
        self._heard.add(robot)

    def mark_exchanged(self, robot: str) -> None:
        """`robot` has answered with its facts."""
        self._exchanged.add(robot)

    def has_all_of(self, robots: Collection[str], peers: Mapping[str, Peer], digest: bytes) -> bool:
        """Whether this robot has all that these know, with `digest` over its own facts."""
        return (bool(self._exchanged) or not robots) and all(
            robot in self._exchanged
            or (
                (peer := peers.get(robot)) is not None
                and peer.heartbeat is not None
                and peer.heartbeat.fact_digest == digest
            )
            for robot in robots
        )

    def still_to_ask(self, peers: Mapping[str, Peer], digest: bytes, now_us: int) -> list[str]:
        """The robots whose facts are still needed, with `digest` over one's own."""
        caught_up = bool(self._exchanged)  # before that, equal digests may be equally old
        if caught_up and now_us >= self._patient_until_us:
            return []
        return [
            robot
            for robot in sorted(self._heard - self._exchanged)
            if (peer := peers.get(robot)) is not None
            and peer.state.is_live
            and not (
                caught_up and peer.heartbeat is not None and peer.heartbeat.fact_digest == digest
            )
        ]

    def is_done(self, awaited: bool, team_is_there: bool, now_us: int) -> bool:
        """Whether the robot may take its place in the team, if nobody's facts are wanted.

        `awaited`: others still count an earlier life of this robot among the living; they are
        given the time to notice. `team_is_there`: somebody has joined already.
        """
        if self._expected <= self._heard and not awaited:
            return True
        return now_us >= (self.deadline_us if team_is_there else self.gathers_until_us)
