"""Who passes on what the robots of a large team plan, so that nobody has to hear it of everybody.

The ring of a mission's robots (`ring`) is cut into *sections*, about as many as each has robots.
The first robots of a section in good standing are its *speakers*: the others tell them when their
plan has changed, and once all in good standing have planned the same, the speakers relay the
section's self-reports to those who wait for agreement. These hear two messages of each section
where they would hear one of every robot: about twice the square root of the team.

What counts is what each robot has said of itself, as ever. Only the way that it takes is another.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Mapping
from math import isqrt

from mrbt_mesh.core.membership.peer import Peer
from mrbt_mesh.core.membership.ring import place
from mrbt_mesh.core.membership.wire import SelfReport

# So many robots speak for a section: another way for a message that is lost, or a link that is
# broken. One that dies is itself a robot whose word is waited for, until it is given up.
SPEAKERS = 2


class Sections:
    """The section of the robot `me` in the ring of a mission's robots, among its `peers`.

    A section has at least as many robots as a robot can have neighbours and itself, so a team in
    which all are neighbours is one section. `reach` as in `Ring`.
    """

    def __init__(
        self, me: str, mission: Collection[str], peers: Mapping[str, Peer], reach: int
    ) -> None:
        self._me = me
        self._peers = peers
        keys = sorted((place(robot), robot) for robot in mission)
        size = max(2 * reach + 1, isqrt(max(0, len(keys) - 1)) + 1)
        self._starts = keys[::size]
        mine = self.of(me)
        names = [robot for _, robot in keys if self.of(robot) == mine]
        self.members = tuple(names if me in names else [*names, me])

    def of(self, robot: str) -> int:
        """The number of a robot's section, also of one that the mission does not name."""
        return max(0, bisect_right(self._starts, (place(robot), robot)) - 1)

    def _is_good(self, robot: str) -> bool:
        peer = self._peers.get(robot)
        return robot == self._me or (peer is not None and peer.state.is_healthy)

    def speakers(self) -> tuple[str, ...]:
        """Those of the own section, as this robot sees it."""
        return tuple([robot for robot in self.members if self._is_good(robot)][:SPEAKERS])

    def relays(self) -> dict[str, SelfReport]:
        """The newest self-reports of the others in it that are in good standing."""
        others = (robot for robot in self.members if robot != self._me)
        return {robot: self._peers[robot].report for robot in others if self._is_good(robot)}

    def all_report(self, digest: bytes) -> bool:
        """Whether all others of the section in good standing report this plan digest."""
        reports = self.relays().values()
        return all(each.has_joined and each.plan_digest == digest for each in reports)
