"""How a new incarnation joins: it listens and catches up before it claims anything.

Otherwise the first process up would agree with itself and start, and one that was replaced while
it slept would go on with stale facts. The facts of a peer are known once it has answered a pull, or
once it reports the digest that this robot has too: what it wrote may have come from others. That
counts only after some peer has answered, since equal digests may be equally old. A peer that never
answers, because it does not hear the newcomer, is waited for no longer than the longest silence.

A robot that hears nobody at all cannot tell a team that is not there from one that it does not
reach. So it waits longer before it does what others may be doing too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from mrbt_mesh.core.membership.peer import Peer
from mrbt_mesh.core.membership.timing import Timing

# Robots of a large team that join at a time: each is news for all.
JOINS_AT_A_TIME = 8


class Joining:
    """Done once facts were exchanged with every peer that is heard, and either all expected
    robots are there or one detection time has passed.

    `is_first`: the process has just started (not: it fenced itself). `keeps_life`: it was silent
    for long and has nothing that others could have taken over, so it only catches up. `refusal` is
    why the last incompatible message was refused. `gather_us`: while nobody has joined yet, the
    expected robots are waited for so long, if that is longer: how long processes take to start has
    nothing to do with how soon a silent one is dead. `alone_after_us`: the same while no robot has
    been heard at all.
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
        # Until when it lets others go first, and how many had joined when that was last put off.
        self.yields_until_us: int | None = None
        self._most_joined = -1

    @property
    def expects_others(self) -> bool:
        """Whether it is alone only if something is wrong, or others have not come yet."""
        return bool(self._expected)

    def mark_heard(self, robot: str) -> None:
        """A heartbeat of `robot` itself arrived."""
        self._heard.add(robot)

    def mark_answered(self, robot: str) -> None:
        """`robot` has answered with its facts."""
        self._answered.add(robot)

    def has_all_of(self, robots: Collection[str], peers: Mapping[str, Peer], digest: bytes) -> bool:
        """Whether this robot has all that these have, with `digest` over its own facts."""
        return (bool(self._answered) or not robots) and all(
            robot in self._answered or _has_digest(peers.get(robot), digest) for robot in robots
        )

    def still_to_ask(self, peers: Mapping[str, Peer], digest: bytes, now_us: int) -> list[str]:
        """The robots whose facts are still needed, with `digest` over one's own."""
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
        """Whether it lets others go first: `ahead` of lower id are about to join too, `joined`
        have done so.

        All robots of a team that starts are ready at the same time. If all joined at once, none of
        them would have time for its heartbeats. It waits as long as more and more do join.
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
        """Whether the expected robots are there: neighbours were heard, others are known, perhaps
        by what their own neighbours relay.
        """
        return all(
            robot in self._heard
            or (robot in peers and peers[robot].state.is_healthy and not are_neighbours(robot))
            for robot in self._expected
        )

    def is_done(
        self, are_all_there: bool, is_other_life_relayed: bool, is_team_there: bool, now_us: int
    ) -> bool:
        """Whether the robot may take its place in the team, if nobody's facts are needed.

        `are_all_there`: the robots that it expects. `is_other_life_relayed`: others still hold an
        earlier life of this robot for alive; they are given the time to notice. `is_team_there`:
        somebody has joined already.
        """
        if are_all_there and not is_other_life_relayed:
            return True
        if is_team_there:
            return now_us >= self.deadline_us
        return now_us >= (self.gathers_until_us if self._heard else self.alone_until_us)


def _has_digest(peer: Peer | None, digest: bytes) -> bool:
    """Whether a peer's last heartbeat has this digest of its facts."""
    return peer is not None and peer.heartbeat is not None and peer.heartbeat.fact_digest == digest
