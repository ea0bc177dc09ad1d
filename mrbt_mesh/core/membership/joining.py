"""How a new incarnation joins: it listens and catches up before it claims anything.

Otherwise the first process up would agree with itself and start, and a process that was replaced
while it slept would continue with stale facts. A peer's facts are known once it has answered a
pull, or once it reports the same digest as this robot, as its facts may have arrived through
others. Equal digests count only after some peer has answered, since both may be equally old. A peer
that never answers, because it does not hear the newcomer, is awaited no longer than the longest
silence.

A robot that hears nobody cannot distinguish an absent team from one that it cannot reach. So it
waits longer before it does what others may be doing too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from mrbt_mesh.core.membership.peer import Peer
from mrbt_mesh.core.membership.timing import Timing

# The most robots of a large team that join at a time, as each is news for all.
JOINS_AT_A_TIME = 8


class Joining:
    """Done once facts were exchanged with every peer that is heard, and either all expected robots
    are present or one detection time has passed.

    `is_first`: the process has just started (as opposed to having fenced itself). `keeps_life`: it
    was silent for long but has nothing that others could have taken over, so it only catches up.
    `refusal`: why the last incompatible message was refused. `gather_us`: how long expected robots
    are awaited while nobody has joined yet, if that is longer than the detection time: the time
    that processes take to start has nothing to do with how soon a silent one is dead.
    `alone_after_us`: the same while no robot has been heard at all.
    """

    def __init__(
        self,
        timing: Timing,
        expected: frozenset[str],
        now_us: int,
        is_first: bool = True,
        gather_us: int = 0,
        alone_after_us: int = 0,
        keeps_life: bool = False,
    ) -> None:
        self.deadline_us = now_us + timing.detection_us
        self.gathers_until_us = max(self.deadline_us, now_us + gather_us)
        self.alone_until_us = max(self.gathers_until_us, now_us + alone_after_us)
        self.is_first = is_first
        self.keeps_life = keeps_life
        self.refusal = ""
        self._ask_until_us = now_us + timing.max_silence_us
        self._expected = expected
        self._timing = timing
        self._heard: set[str] = set()
        self._answered: set[str] = set()
        # Until when it lets others go first; how many had joined when that was last extended.
        self.yields_until_us: int | None = None
        self._most_joined = -1

    @property
    def expects_others(self) -> bool:
        """True if other robots are expected, so that being alone is a problem or temporary."""
        return bool(self._expected)

    def mark_heard(self, robot: str) -> None:
        """Note that a heartbeat of `robot` itself arrived."""
        self._heard.add(robot)

    def mark_answered(self, robot: str) -> None:
        """Note that `robot` has answered with its facts."""
        self._answered.add(robot)

    def has_all_of(self, robots: Collection[str], peers: Mapping[str, Peer], digest: bytes) -> bool:
        """True if this robot has all facts of these robots. `digest`: of its own facts."""
        return (bool(self._answered) or not robots) and all(
            robot in self._answered or _has_digest(peers.get(robot), digest) for robot in robots
        )

    def still_to_ask(self, peers: Mapping[str, Peer], digest: bytes, now_us: int) -> list[str]:
        """The robots whose facts are still needed. `digest`: of this robot's own facts."""
        has_caught_up = bool(self._answered)
        if has_caught_up and now_us >= self._ask_until_us:
            return []
        return [
            robot
            for robot, peer in sorted(peers.items())
            if robot in self._heard
            and robot not in self._answered
            and peer.state.is_member
            and not (has_caught_up and _has_digest(peer, digest))
        ]

    def yields(self, ahead: int, joined: int, now_us: int) -> bool:
        """True if this robot lets others go first. `ahead`: the number of robots with a lower id
        that are about to join too; `joined`: the number that have joined.

        All robots of a starting team are ready at the same time. If all joined at once, none would
        have time for its heartbeats. A robot waits as long as the number of joined robots keeps
        growing.
        """
        if ahead < JOINS_AT_A_TIME:
            return False
        if self.yields_until_us is None or joined > self._most_joined:
            self._most_joined = joined
            self.yields_until_us = now_us + self._timing.detection_us
        return now_us < self.yields_until_us

    def are_all_there(
        self, peers: Mapping[str, Peer], are_neighbours: Callable[[str], bool]
    ) -> bool:
        """True once every expected neighbour was heard and every other expected robot is known,
        directly or by relay.
        """
        return all(
            robot in self._heard
            or (robot in peers and peers[robot].state.is_healthy and not are_neighbours(robot))
            for robot in self._expected
        )

    def is_done(
        self, are_all_there: bool, is_other_life_relayed: bool, is_team_there: bool, now_us: int
    ) -> bool:
        """True if the robot may join, provided that nobody's facts are still needed.

        `are_all_there`: all expected robots are present. `is_other_life_relayed`: others still
        consider an earlier incarnation of this robot alive; they get time to notice.
        `is_team_there`: some robot has joined already.
        """
        if are_all_there and not is_other_life_relayed:
            return True
        if is_team_there:
            return now_us >= self.deadline_us
        return now_us >= (self.gathers_until_us if self._heard else self.alone_until_us)


def _has_digest(peer: Peer | None, digest: bytes) -> bool:
    """True if a peer's last heartbeat has this digest of its facts."""
    return peer is not None and peer.heartbeat is not None and peer.heartbeat.fact_digest == digest
