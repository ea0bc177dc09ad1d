"""When a silent robot is suspected, probed and declared dead.

1. *Suspect*: nothing was heard of the robot for half of its silence limit, or its liveliness token
   is lost. While it is silent it is also *probed*: the robot itself and all robots that hear it
   send heartbeats faster, so that news may arrive by another way (SWIM's indirect probe).
2. *Dead*: nothing was heard of it for its whole silence limit, or all other healthy robots that
   judge it lost its token too. If another robot has declared it dead, half of the limit is enough;
   in a large team it is then dead at once if its token is lost here as well.

The silence limit is derived from how regularly news of this robot came so far (`ArrivalHistory`,
`Timing.silence_limit_us`). When most robots fall silent together, the fault is probably on this
side, and all of them are given one more detection time.

An observer declares a silent robot dead when a robot of the team does, or when it sees no healthy
robot that could: a robot that only the observer does not hear is not dead for the team.

Sources: SWIM (Das, Gupta, Motivala 2002); Lifeguard (Dadgar, Phillips, Currey 2018).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mrbt_mesh.core.membership.dissemination import Dissemination
from mrbt_mesh.core.membership.peer import Peer, State
from mrbt_mesh.core.membership.timing import Timing

# A robot is probed once it has been silent for this fraction of its limit: one half.
PROBE_SHARE = 2


class FailureDetector:
    """Judges `peers`, which its owner changes. Writes only their thresholds and `is_probed`."""

    def __init__(
        self, timing: Timing, peers: Mapping[str, Peer], around: Dissemination, is_observer: bool
    ) -> None:
        self._timing = timing
        self._peers = peers
        self._around = around
        self._is_observer = is_observer

    def learn_arrival(self, peer: Peer, now_us: int) -> None:
        """Learn from the time between news of a robot, just arrived, and the news before."""
        arrivals = peer.arrivals
        arrivals.add_interval(now_us - peer.last_heard_us, self._timing)
        limit_us = self._timing.silence_limit_us(arrivals.overdue_permille)
        if limit_us != peer.silence_limit_us:
            peer.silence_limit_us, peer.probe_after_us = limit_us, limit_us // PROBE_SHARE

    def find_suspects(self, token_lost: Collection[str], now_us: int) -> list[str]:
        """Return the members that are silent, now probed, or whose token is lost; sorted."""
        peers, suspects = self._peers, []
        for robot, peer in self._around.judged.items():
            peer.is_probed = is_silent(peer, now_us)
            if peer.is_probed:
                suspects.append(robot)
        suspects += [r for r in token_lost if peers[r].state.is_member and not peers[r].is_probed]
        return sorted(suspects)

    def find_dead(self, candidates: Collection[str], now_us: int) -> list[str]:
        """Return the dead among these candidates: suspects and accused robots. Sorted."""
        judged = self._around.judged
        silent = sum(peer.is_probed for peer in judged.values())
        is_most = silent > 1 and 2 * silent > len(judged)
        extra_us = self._around.patience_us + self._timing.detection_us * is_most
        return [robot for robot in sorted(candidates) if self._is_dead(robot, now_us - extra_us)]

    def _is_dead(self, robot: str, now_us: int) -> bool:
        peer = self._peers[robot]
        if not peer.state.is_member:
            return False
        accusers = self.accusers(peer)
        if peer.is_judged and peer.state is State.SUSPECT:
            limit_us = peer.silence_limit_us
            if accusers:
                limit_us = max(self._timing.detection_us, peer.probe_after_us)
            if now_us - peer.last_heard_us >= limit_us and self._may_judge_silence(accusers):
                return True
            if peer.is_token_lost and self._has_everybody_lost_token(robot, peer):
                return True
        return self._around.is_given_up(robot, peer, accusers)

    def accusers(self, peer: Peer) -> int:
        """The number of healthy robots that have declared this one dead."""
        others = map(self._peers.get, peer.declared_dead_by)
        return sum(other is not None and other.state.is_healthy for other in others)

    def _may_judge_silence(self, accusers: int) -> bool:
        """True if silence as this robot hears it is enough to declare a robot dead."""
        if not self._is_observer or accusers:
            return True
        peers = self._peers.values()
        return not any(other.state.is_healthy and other.report.has_joined for other in peers)

    def _has_everybody_lost_token(self, robot: str, peer: Peer) -> bool:
        """True if there are joined witnesses of this robot, and all of them lost its token."""
        witnesses = [r for r in self._around.witnesses(robot) if self._peers[r].report.has_joined]
        return bool(witnesses) and peer.token_lost_by.issuperset(witnesses)

    def next_due_us(self, now_us: int) -> int:
        """When a judgement may change, if nothing is heard until then."""
        detection_us, extra_us = self._timing.detection_us, self._around.patience_us
        earliest_us = now_us + detection_us
        for peer in self._around.judged.values():
            limits_us = (detection_us, peer.silence_limit_us, peer.probe_after_us)
            waits_us = (peer.probe_after_us, *(limit_us + extra_us for limit_us in limits_us))
            for wait_us in waits_us:
                at_us = peer.last_heard_us + wait_us
                if at_us <= now_us:
                    at_us += detection_us  # the extra time that it gets when most are silent
                if now_us < at_us < earliest_us:
                    earliest_us = at_us
        return earliest_us


def is_silent(peer: Peer, now_us: int) -> bool:
    """True if nothing was heard of the robot for so long that it is probed."""
    return now_us - peer.last_heard_us >= peer.probe_after_us
