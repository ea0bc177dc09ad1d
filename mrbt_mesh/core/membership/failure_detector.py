"""When a silent robot is suspected, probed and declared dead.

1. *Suspect*: nothing was heard of it for half of its silence limit, or its liveliness token is
   gone. While it is silent it is also *probed*: all who hear it, and it itself, send heartbeats
   faster, so that news may come by another way (SWIM's indirect probe).
2. *Dead*: nothing was heard of it for its whole silence limit, or all others in good standing that
   judge it lost its token too. If another robot has declared it dead, half of the limit is enough;
   in a large team nothing more is waited for if its token is gone here as well.

The silence limit follows from how regularly news of this robot came so far (`ArrivalHistory`,
`Timing.silence_limit_us`). When most robots fall silent together, the fault is probably here, and
all of them are given one detection time more.

Who only watches a team holds a silent robot for dead when one of the team does, or nobody is left
there who could: that it has not heard a robot itself is no fault of the team's.

Sources: SWIM (Das, Gupta, Motivala 2002); Lifeguard (Dadgar, Phillips, Currey 2018).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mrbt_mesh.core.membership.neighbourhood import Neighbourhood
from mrbt_mesh.core.membership.peer import Peer, State
from mrbt_mesh.core.membership.timing import Timing

# A robot is probed once it has been silent for one part in so many of its limit.
PROBE_SHARE = 2


class FailureDetector:
    """Judges the peers of one robot, or of whoever only watches (`is_observer`). It changes their
    thresholds and `is_probed`, nothing else.
    """

    def __init__(self, timing: Timing, is_observer: bool = False) -> None:
        self._timing = timing
        self._is_observer = is_observer
        # By share of overdue news.
        self._silence_limits_us: dict[int, int] = {}

    def silence_limit_us(self, overdue_permille: int) -> int:
        """`Timing.silence_limit_us`, worked out once for each share."""
        limit_us = self._silence_limits_us.get(overdue_permille)
        if limit_us is None:
            limit_us = self._timing.silence_limit_us(overdue_permille)
            self._silence_limits_us[overdue_permille] = limit_us
        return limit_us

    def learn_arrival(self, peer: Peer, now_us: int) -> None:
        """News of a live robot has arrived: learn from the time since the news before.

        The silence of a dead robot says nothing about the network.
        """
        arrivals = peer.arrivals
        arrivals.add_interval(now_us - peer.last_heard_us, self._timing)
        limit_us = self.silence_limit_us(arrivals.overdue_permille)
        if limit_us != peer.silence_limit_us:
            peer.silence_limit_us, peer.probe_after_us = limit_us, limit_us // PROBE_SHARE

    def find_suspects(
        self,
        judged: Mapping[str, Peer],
        token_lost: Collection[str],
        peers: Mapping[str, Peer],
        now_us: int,
    ) -> list[str]:
        """The live robots that are silent, which are probed, or whose token is gone.

        `judged`: those whose silence tells. `token_lost`: those without a token.
        """
        suspects = []
        for robot, peer in judged.items():
            peer.is_probed = is_silent(peer, now_us)
            if peer.is_probed:
                suspects.append(robot)
        suspects += [r for r in token_lost if peers[r].state.is_member and not peers[r].is_probed]
        return sorted(suspects)

    def find_dead(
        self,
        around: Neighbourhood,
        suspected: Collection[str],
        accused: Collection[str],
        peers: Mapping[str, Peer],
        now_us: int,
    ) -> list[str]:
        """The robots that are dead, sorted.

        Of those that it judges, suspects that have been silent for too long or whose token is gone
        everywhere. Of others, `accused`, those that most of their neighbours have declared dead.
        One who has is enough if the token is gone here as well, but in a team of neighbours, where
        each hears of the tokens of all himself.
        """
        extra_us = self._extra_us(around.judged)
        dead = []
        for robot in sorted({*suspected, *accused}):
            peer = peers[robot]
            if not peer.state.is_member:
                continue
            if not peer.is_judged:
                is_dead = _is_given_up(robot, around, peers)
            else:
                silent_us = now_us - peer.last_heard_us
                is_dead = peer.state is State.SUSPECT and (
                    (
                        silent_us >= self._limit_us(peer, peers) + extra_us
                        and self._may_judge_silence(peer, peers)
                    )
                    or _has_everybody_lost_token(robot, around, peers)
                    or (not around.is_complete and _is_confirmed(peer, peers))
                )
            if is_dead:
                dead.append(robot)
        return dead

    def _extra_us(self, judged: Mapping[str, Peer]) -> int:
        """How much longer to wait when most robots are silent together."""
        silent = sum(peer.is_probed for peer in judged.values())
        return self._timing.detection_us if silent > 1 and 2 * silent > len(judged) else 0

    def _limit_us(self, peer: Peer, peers: Mapping[str, Peer]) -> int:
        """The silence after which a suspect is dead: less if another robot has declared it dead."""
        if _accusers(peer, peers):
            return max(self._timing.detection_us, peer.probe_after_us)
        return peer.silence_limit_us

    def _may_judge_silence(self, peer: Peer, peers: Mapping[str, Peer]) -> bool:
        """Whether a robot is dead because nothing was heard of it here."""
        if not self._is_observer or _accusers(peer, peers):
            return True
        return not any(
            other.state.is_healthy and other.report.has_joined for other in peers.values()
        )

    def is_told(self, peer: Peer, peers: Mapping[str, Peer]) -> bool:
        """Whether everybody has heard of this death: one has told it, which is enough for all
        whose token of the dead is gone, as it is here.
        """
        return _is_confirmed(peer, peers)

    def next_due_us(self, judged: Mapping[str, Peer], extra_us: int, now_us: int) -> int:
        """When a judgement may differ from the present one, if nothing is heard until then.

        `extra_us`: how much longer than their limits the silent may be.
        """
        detection_us = self._timing.detection_us
        earliest_us = now_us + detection_us
        for peer in judged.values():
            limits_us = (detection_us, peer.silence_limit_us, peer.probe_after_us)
            waits_us = (peer.probe_after_us, *(limit_us + extra_us for limit_us in limits_us))
            for wait_us in waits_us:
                at_us = peer.last_heard_us + wait_us
                if at_us <= now_us:
                    at_us += detection_us  # the time that it is given when most are silent
                if now_us < at_us < earliest_us:
                    earliest_us = at_us
        return earliest_us


def is_silent(peer: Peer, now_us: int) -> bool:
    """Whether nothing was heard of it for so long that it is probed."""
    return now_us - peer.last_heard_us >= peer.probe_after_us


def _has_everybody_lost_token(robot: str, around: Neighbourhood, peers: Mapping[str, Peer]) -> bool:
    """Whether all others that judge this robot lost its token, as this one did.

    All of whom this one hears, that are in good standing.
    """
    if not peers[robot].is_token_lost:
        return False
    heard = around.robots
    witnesses = [
        name
        for name in around.monitors(robot)
        if name in heard and peers[name].state.is_healthy and peers[name].report.has_joined
    ]
    return bool(witnesses) and all(name in peers[robot].token_lost_by for name in witnesses)


def _is_given_up(robot: str, around: Neighbourhood, peers: Mapping[str, Peer]) -> bool:
    """Whether those who judge a robot have declared it dead: most of them, or one at least if its
    token is gone here too.
    """
    believed = _accusers(peers[robot], peers)
    return _is_confirmed(peers[robot], peers) or believed > len(around.monitors(robot)) // 2


def _is_confirmed(peer: Peer, peers: Mapping[str, Peer]) -> bool:
    """Whether a robot in good standing has declared it dead, and its token is gone here too."""
    return peer.is_token_lost and _accusers(peer, peers) > 0


def _accusers(peer: Peer, peers: Mapping[str, Peer]) -> int:
    """How many robots in good standing have declared it dead."""
    others = map(peers.get, peer.declared_dead_by)
    return sum(other is not None and other.state.is_healthy for other in others)
