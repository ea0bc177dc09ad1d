"""How a new incarnation joins: it listens and catches up before it claims anything.

Otherwise the first process up would agree with itself and start, and one that was replaced
while it slept would carry on with stale facts. Facts are exchanged with a peer once it has
answered or, after another one has, tells the same digest: what it wrote may come from others,
and one that does not hear the newcomer holds up nobody.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mrbt_mesh.core.membership import Peer, State
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

    def knows_all_of(self, robots: Collection[str], peers: Mapping[str, Peer]) -> bool:
        """Whether each of these robots lives and was heard: nobody who is missing knows more.

        To be asked where nobody's facts are wanted any more.
        """
        living = {r for r in robots if r in peers and peers[r].state in (State.ALIVE, State.SUSPECT)}
        return living == set(robots) and self._heard.issuperset(robots)

    def wanted(self, peers: Mapping[str, Peer], digest: bytes) -> list[str]:
        """The robots whose facts are still needed, with `digest` over one's own."""
        caught_up = bool(self._exchanged)  # before that, equal digests may be equally old
        return [
            robot
            for robot in sorted(self._heard - self._exchanged)
            if (peer := peers.get(robot)) is not None
            and peer.state in (State.ALIVE, State.SUSPECT)
            and not (caught_up and peer.beat is not None and peer.beat.fact_digest == digest)
        ]

    def is_done(self, awaited: bool, now_us: int) -> bool:
        """Whether the robot may take its place in the team, if nobody's facts are wanted.

        `awaited`: others still count an earlier life of this robot among the living; they are
        given the time to notice.
        """
        if now_us >= self.deadline_us:
            return True
        return self._expected <= self._heard and not awaited
