"""Whom one robot sends its heartbeats to, and whose silence it judges.

Its neighbours in the ring of all robots in good standing (`ring`). Besides them, as far as that is
not everybody anyway:

- one more robot with each heartbeat, all of the team in turn, dead ones included: so two parts of a
  team that were cut off from each other find out, and whoever has missed a change hears of it;
- whoever judges this robot, or is new, by its own last heartbeat: two robots that see different
  rings hear each other;
- while it is about to join, some that it has not heard yet;
- robots that are *checked*: others say otherwise of them than is known here.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterable, Mapping, Sequence

from mrbt_mesh.core.membership.peer import Peer, State, set_member
from mrbt_mesh.core.membership.ring import Ring
from mrbt_mesh.core.membership.timing import Timing

# So many robots are checked at a time, and so many sought by a newcomer.
MAX_CHECKED = 16
SOUGHT_AT_A_TIME = 4


class Neighbourhood:
    """Of the robot `me` among its `peers`, a mapping that its owner changes.

    `judged`: the live robots whose silence it judges. `reach` as in `Ring`.
    """

    def __init__(self, me: str, timing: Timing, peers: Mapping[str, Peer], reach: int) -> None:
        self.me = me
        self.judged: dict[str, Peer] = {}
        self._timing = timing
        self._peers = peers
        self._reach = reach
        self._ring = Ring([me], reach)
        # Of whom something has changed since it was looked at, and whether anything else has.
        self._changed: set[str] = set()
        self._is_stale = True
        self._suspects: set[str] = set()
        self._in_turn: list[str] | None = None
        self._checked_until_us: dict[str, int] = {}
        self._to_answer: set[str] = set()

    def note_change(self, robot: str) -> None:
        """A robot is new, or in another state than before."""
        self._changed.add(robot)

    def follow(self, now_us: int) -> None:
        """Be up to date with who is in good standing.

        A robot that is judged from now on has not been silent before.
        """
        if not (self._changed or self._is_stale):
            return
        peers, ring, me = self._peers, self._ring, self.me
        for robot in self._changed:
            state = peers[robot].state
            ring.put(robot, state.is_healthy)
            set_member(self._suspects, robot, state is State.SUSPECT)
            self._in_turn = None
            # A change far away makes no difference to this robot.
            self._is_stale |= robot in self.judged or ring.are_near(robot, me)
        self._changed.clear()
        if not self._is_stale:
            return
        self._is_stale = False
        checked = (r for r in self._checked_until_us if r in peers and peers[r].state.is_member)
        suspects = (robot for robot in self._suspects if ring.are_near(robot, me))
        mine = {*ring.neighbours(me), *checked, *suspects}
        for robot in self.judged.keys() - mine:
            peers[robot].is_judged = peers[robot].is_probed = False
        self.judged = {robot: peers[robot] for robot in sorted(mine)}
        for peer in self.judged.values():
            if not peer.is_judged and not ring.is_complete:
                peer.last_heard_us = max(peer.last_heard_us, now_us)
            peer.is_judged = True

    @property
    def is_complete(self) -> bool:
        """Whether everybody is everybody's neighbour."""
        return self._ring.is_complete

    @property
    def robots(self) -> tuple[str, ...]:
        """Its neighbours, sorted."""
        return self._ring.neighbours(self.me)

    def judges(self, robot: str) -> bool:
        """Whether it judges a robot, or would if that were alive."""
        return robot in self.judged or self._ring.are_near(robot, self.me)

    def monitors(self, robot: str) -> tuple[str, ...]:
        """The robots in good standing that judge a robot."""
        return self._ring.neighbours(robot)

    # -- checks -------------------------------------------------------------------------------

    def check(self, robot: str, now_us: int) -> bool:
        """Listen for a robot for some time, and let it hear from this one; whether that is new."""
        if robot in self._checked_until_us or len(self._checked_until_us) >= MAX_CHECKED:
            return False
        self._checked_until_us[robot] = now_us + self._timing.max_detection_us
        self._is_stale = True
        return True

    def heard(self, robot: str) -> None:
        """A heartbeat of the robot itself has come."""
        if self._checked_until_us.pop(robot, None) is not None:
            self._is_stale = True

    @property
    def checks_end_us(self) -> list[int]:
        """When those that go on are given up."""
        return list(self._checked_until_us.values())

    def end_checks(self, now_us: int) -> None:
        """Give up those that have led to nothing."""
        for robot, until_us in list(self._checked_until_us.items()):
            if now_us >= until_us:
                self.heard(robot)

    # -- who hears it -------------------------------------------------------------------------

    def answer(self, robot: str) -> None:
        """Let a robot hear this one's next heartbeat."""
        self._to_answer.add(robot)

    def audience(
        self,
        number: int,
        mission: Collection[str],
        others: Iterable[str],
        seeks: bool = False,
    ) -> tuple[str, ...] | None:
        """Who gets heartbeat `number`, sorted; None: everybody. Those that wait have an answer.

        `mission`: the robots that may be there, heard or not. `others`: who is to have it, besides.
        `seeks`: it is about to join, so it looks for those that it has not heard yet.
        """
        answered, self._to_answer = self._to_answer, set()
        # Who starts in a large team knows few at first, and the others are as many all the same.
        if self.is_complete and self._timing.is_small(len(mission)):
            return None
        wanted = {*self.robots, *self.judged, *self._checked_until_us, *answered, *others}
        for robot, peer in self.judged.items():
            if peer.is_probed:
                wanted.update(self.monitors(robot))
        if self._in_turn is None:
            left = {robot for robot, peer in self._peers.items() if peer.state is State.LEFT}
            self._in_turn = sorted({*self._peers, *mission} - left - {self.me})
        wanted.update(self._of_all(self._in_turn, number, 1))
        if seeks:
            known = {robot for robot, peer in self._peers.items() if peer.heartbeat is not None}
            unheard = [robot for robot in self._in_turn if robot not in known]
            wanted.update(self._of_all(unheard, number, SOUGHT_AT_A_TIME))
        return tuple(sorted(robot for robot in wanted if not self._has_left(robot)))

    def _of_all(self, robots: Sequence[str], number: int, count: int) -> list[str]:
        """So many of these robots, others for each number.

        Robots that started together begin with different ones, not all with the same.
        """
        begin = bisect_left(robots, self.me) + number * count
        return [robots[(begin + k) % len(robots)] for k in range(min(count, len(robots)))]

    def _has_left(self, robot: str) -> bool:
        """Whether a robot is gone on purpose, or is this one."""
        peer = self._peers.get(robot)
        return robot == self.me or (peer is not None and peer.state is State.LEFT)
