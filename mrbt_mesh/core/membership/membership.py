"""Who is alive: beats decide, liveliness tokens hint, others are heard before a verdict.

Every beat relays the newest beats that its sender knows, and its suspicions. That is SWIM's
indirect probe: a robot that anybody still hears is alive for everybody, and a robot whose
token everybody lost at once is dead without waiting for a timeout. How long a robot may be
silent follows from how regularly news of it came so far (`hearing`, `Timing.limit_us`). After
half of that it is sought: all beat faster, those who hear it and itself as well. Death is a
local judgement about one incarnation; a newer beat of it revives it.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.arrival_history import ArrivalHistory
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport, Suspicion

# A robot is sought once it has been silent for one part in so many of its limit.
SEEK_SHARE = 2


class State(enum.StrEnum):
    """A robot as another one sees it. LEFT: gone on purpose.

    `is_alive`: in good standing. `is_present`: neither dead nor gone. `is_distrusted`: neither
    alive nor gone on purpose.
    """

    ALIVE = "alive"
    SUSPECT = "suspect"
    DEAD = "dead"
    LEFT = "left"

    # Asked with every message, as members of an enumeration are slow to look up.
    def __init__(self, name: str) -> None:
        self.is_alive = name == "alive"
        self.is_live = name in ("alive", "suspect")
        self.is_suspected = name in ("suspect", "dead")


@dataclass(slots=True)
class Peer:
    """What is known of one robot's newest incarnation, by its newest `word`.

    `evidence_us` is when a newer beat than before arrived, from itself or relayed; after
    `limit_us` of silence it is dead. After `seek_us` it is `sought`, and left out when agreement is
    counted. `accusers` are the robots that lost its token too, `buriers` those that hold it for
    dead.
    """

    incarnation: Incarnation
    report: SelfReport
    last_heard_us: int
    arrivals: ArrivalHistory
    silence_limit_us: int
    probe_after_us: int
    heartbeat: Heartbeat | None = None
    is_probed: bool = False
    is_token_lost: bool = False
    state: State = State.ALIVE
    token_lost_by: set[str] = field(default_factory=set)
    declared_dead_by: set[str] = field(default_factory=set)


class Membership:
    """One robot's view of the others. `me` never appears in it.

    `changes` grows with every change of who is alive, `hints` with every token that comes or
    goes and every accusation, `reports` when a robot reports another plan or result. Until
    `at_peace_until_us`, and while nothing of it changes, `judge` would say nothing new.
    """

    def __init__(self, me: str, timing: Timing) -> None:
        self.me = me
        self.timing = timing
        self.peers: dict[str, Peer] = {}
        self.alive_changes = 0
        self.suspicion_changes = 0
        self.report_changes = 0
        self.next_detection_us = 0
        self._judged = -1
        self._accusers: set[str] = set()
        self._distrusted: dict[str, Peer] = {}
        self._limits_us: dict[int, int] = {}

    def is_new_relay(self, row: list[Any]) -> bool:
        """Whether a relay [robot, counter, nonce, number, ...] may tell more than is known."""
        robot, counter, nonce, number = row[:4]
        peer = self.peers.get(robot) if isinstance(robot, str) else None
        if peer is None or type(number) is not int:
            return True
        return number > peer.report.number or (counter, nonce) != peer.incarnation

    def receive_heartbeat(self, robot: str, heartbeat: Heartbeat, now_us: int) -> bool:
        """Take in a beat that came from `robot` itself; False if it is old news."""
        if not self._news(robot, heartbeat.report, now_us, heartbeat):
            return False
        peers, me = self.peers, self.me
        for name, word in heartbeat.relays.items():
            known = peers.get(name)
            # Most relays tell nothing new.
            if known is None:
                if name != me:
                    self._news(name, word, now_us, None)
            elif word is not known.report and (
                word.number > known.report.number or word.incarnation != known.incarnation
            ):
                self._news(name, word, now_us, None)
        if heartbeat.suspicions or robot in self._accusers:
            self._take_accusations(robot, heartbeat.suspicions)
        return True

    def _take_accusations(self, robot: str, accusations: tuple[Suspicion, ...]) -> None:
        """What a robot says of others, in place of what it said before."""
        for accusation in accusations:
            self._accused(robot, accusation)
        accused = {accusation.robot for accusation in accusations}
        for name, peer in self.peers.items():
            if name not in accused and (
                robot in peer.token_lost_by or robot in peer.declared_dead_by
            ):
                peer.token_lost_by.discard(robot)
                peer.declared_dead_by.discard(robot)
                self.suspicion_changes += 1
        if accused:
            self._accusers.add(robot)
        else:
            self._accusers.discard(robot)

    def _news(self, robot: str, word: SelfReport, now_us: int, beat: Heartbeat | None) -> bool:
        """Take in a robot's word, from its own `beat` or else relayed."""
        peer = self.peers.get(robot)
        if peer is None or word.incarnation != peer.incarnation:
            if peer is not None and word.incarnation < peer.incarnation:
                return False
            peer = self._newcomer(robot, word, peer, now_us)
        elif word.number > peer.report.number:
            self._listen(peer, now_us)
        elif beat is not None and word.number == peer.report.number:
            peer.heartbeat = beat
            return peer.state.is_live
        else:
            return False
        before, peer.report, peer.last_heard_us = peer.report, word, now_us
        if word.plan_digest != before.plan_digest or word.result != before.result:
            self.report_changes += 1
        if word.has_joined != before.has_joined:
            self.alive_changes += 1
        if beat is not None:
            # Only the robot's own word takes back a lost token: a relay may be older than the loss.
            peer.heartbeat = beat
            if peer.is_token_lost or peer.token_lost_by:
                peer.is_token_lost = False
                peer.token_lost_by.clear()
                self.suspicion_changes += 1
            if beat.is_leaving:
                self._set(robot, peer, State.LEFT)
            elif not peer.state.is_alive:
                self._set(robot, peer, State.ALIVE)
        elif peer.state is State.DEAD or (peer.state is State.SUSPECT and not peer.is_token_lost):
            self._set(robot, peer, State.ALIVE)
        return True

    def _newcomer(self, robot: str, word: SelfReport, before: Peer | None, now_us: int) -> Peer:
        """A robot's new life is heard over the same network as the one before."""
        hearing = (
            before.arrivals if before is not None else ArrivalHistory.of_new_robot(self.timing)
        )
        limit_us = self._limit_us(hearing.overdue_permille)
        self.alive_changes += 1
        self._distrusted.pop(robot, None)
        peer = self.peers[robot] = Peer(
            word.incarnation,
            word,
            now_us,
            hearing,
            limit_us,
            limit_us // SEEK_SHARE,
        )
        return peer

    def _listen(self, peer: Peer, now_us: int) -> None:
        """Learn from the time between two pieces of news; an outage is none of the network's."""
        if peer.state.is_live:
            hearing, limits_us = peer.arrivals, self._limits_us
            hearing.add_interval(now_us - peer.last_heard_us, self.timing)
            permille = hearing.overdue_permille
            limit_us = limits_us[permille] if permille in limits_us else self._limit_us(permille)
            if limit_us != peer.silence_limit_us:
                peer.silence_limit_us, peer.probe_after_us = limit_us, limit_us // SEEK_SHARE
        peer.is_probed = False
        if peer.declared_dead_by:
            peer.declared_dead_by.clear()
        # The limit may have become shorter.
        seek_at_us = now_us + peer.probe_after_us
        if seek_at_us < self.next_detection_us:
            self.next_detection_us = seek_at_us

    def _limit_us(self, silence_permille: int) -> int:
        if silence_permille not in self._limits_us:
            self._limits_us[silence_permille] = self.timing.silence_limit_us(silence_permille)
        return self._limits_us[silence_permille]

    def _accused(self, accuser: str, accusation: Suspicion) -> None:
        peer = self.peers.get(accusation.robot)
        if peer is not None and accusation.incarnation == peer.incarnation:
            self.suspicion_changes += 1
            if accusation.is_token_lost:
                peer.token_lost_by.add(accuser)
            else:
                peer.token_lost_by.discard(accuser)
            if accusation.is_dead:
                peer.declared_dead_by.add(accuser)
            else:
                peer.declared_dead_by.discard(accuser)

    def can_answer_probe(self, heartbeat: Heartbeat, mine: Incarnation) -> bool:
        """Whether the sender seeks a robot of which this one has news: others, or itself."""
        for accusation in heartbeat.suspicions:
            if accusation.is_probe:
                peer = self.peers.get(accusation.robot)
                asked = accusation.robot == self.me and accusation.incarnation == mine
                if asked or (
                    peer is not None
                    and peer.state.is_alive
                    and peer.incarnation == accusation.incarnation
                ):
                    return True
        return False

    @property
    def live_peer_count(self) -> int:
        """How many others there are, neither dead nor gone."""
        return sum(peer.state.is_live for peer in self.peers.values())

    @property
    def is_probing(self) -> bool:
        """Whether a robot that is not given up has been silent for too long."""
        distrusted = self._distrusted
        return bool(distrusted) and any(peer.is_probed for peer in distrusted.values())

    def receive_token(self, robot: str, incarnation: Incarnation, is_held: bool) -> None:
        """A liveliness token came (held) or went. Its presence proves nothing."""
        peer = self.peers.get(robot)
        if peer is not None and peer.incarnation == incarnation:
            peer.is_token_lost = not is_held
            self.suspicion_changes += 1

    def allow_for_own_lag(self, lag_us: int, now_us: int) -> None:
        """This robot itself was late by `lag_us`: messages may wait unread, so blame nobody yet.

        Source: Lifeguard's local health, as a shift of what was last heard.
        """
        for peer in self.peers.values():
            peer.last_heard_us = min(now_us, peer.last_heard_us + lag_us)

    def is_at_peace(self, now_us: int) -> bool:
        """Whether `judge` would find nothing new."""
        if self._judged != self.alive_changes + self.suspicion_changes:
            return False
        if now_us < self.next_detection_us:
            return True
        if self._distrusted or any(
            peer.state.is_live and now_us - peer.last_heard_us >= peer.probe_after_us
            for peer in self.peers.values()
        ):
            return False
        # Newer evidence has put it off.
        self.next_detection_us = self._next_judgement_us(now_us)
        return True

    def detect_failures(self, now_us: int) -> list[tuple[str, State, State]]:
        """Suspect and bury; returns (robot, before, after) for every change."""
        if self.is_at_peace(now_us):
            return []
        before = {robot: peer.state for robot, peer in self.peers.items()}
        silent = 0
        for robot, peer in self.peers.items():
            peer.is_probed = (
                peer.state.is_live and now_us - peer.last_heard_us >= peer.probe_after_us
            )
            silent += peer.is_probed
            if peer.is_probed or (peer.state.is_live and peer.is_token_lost):
                self._set(robot, peer, State.SUSPECT)
        extra_us = self._extra_us(silent)
        for robot in sorted(self.peers):
            peer = self.peers[robot]
            if peer.state is State.SUSPECT and (
                now_us - peer.last_heard_us >= self._patience_us(peer) + extra_us
                or self._everybody_lost(robot, peer)
            ):
                self._set(robot, peer, State.DEAD)
                peer.is_probed = False
        self._judged = self.alive_changes + self.suspicion_changes
        self.next_detection_us = self._next_judgement_us(now_us)
        return [
            (robot, before[robot], self.peers[robot].state)
            for robot in sorted(before)
            if before[robot] is not self.peers[robot].state
        ]

    def _extra_us(self, silent: int) -> int:
        """When most peers fall silent together, the fault is probably here: wait once more."""
        most = silent > 1 and 2 * silent > self.live_peer_count
        return self.timing.detection_us if most else 0

    def _patience_us(self, peer: Peer) -> int:
        """The silence after which a suspect is dead: less if another robot has buried it."""
        buried = any(
            other is not None and other.state.is_alive
            for other in map(self.peers.get, peer.declared_dead_by)
        )
        return (
            max(self.timing.detection_us, peer.probe_after_us) if buried else peer.silence_limit_us
        )

    def _everybody_lost(self, robot: str, peer: Peer) -> bool:
        """Whether all others that are in good standing lost this robot's token as well."""
        if not peer.is_token_lost:
            return False
        witnesses = [
            name
            for name, other in self.peers.items()
            if name != robot and other.report.has_joined and other.state.is_alive
        ]
        return bool(witnesses) and all(name in peer.token_lost_by for name in witnesses)

    def _set(self, robot: str, peer: Peer, state: State) -> None:
        if peer.state is state:
            return
        peer.state = state
        if state.is_suspected:
            self._distrusted[robot] = peer
        else:
            self._distrusted.pop(robot, None)
        self.alive_changes += 1

    def alive_set(self) -> dict[str, Incarnation]:
        """Joined robots that are not dead or gone, suspects included: the plan's alive set."""
        return {
            robot: peer.incarnation
            for robot, peer in sorted(self.peers.items())
            if peer.report.has_joined and peer.state.is_live
        }

    def suspicions(self) -> tuple[Suspicion, ...]:
        """What this robot's next beat says of those it does not trust."""
        if not self._distrusted:
            return ()
        return tuple(
            Suspicion(
                robot,
                peer.incarnation,
                peer.is_token_lost,
                peer.state is State.DEAD,
                peer.is_probed,
            )
            for robot, peer in sorted(self._distrusted.items())
        )

    def relays(self) -> dict[str, SelfReport]:
        """The relays that this robot's next beat carries, sorted by robot."""
        return {
            robot: peer.report for robot, peer in sorted(self.peers.items()) if peer.state.is_alive
        }

    def all_report_plan(self, digest: bytes) -> bool:
        """Whether every robot in good standing reports this plan digest.

        One that is still joining for the first time reports none, so it is waited for too.
        """
        for peer in self.peers.values():
            if peer.state.is_alive and not (
                peer.report.has_joined and peer.report.plan_digest == digest
            ):
                return False
        return True

    def all_report_result(self, result: int) -> bool:
        """Whether every robot of the alive set, suspects included, beats this mission status."""
        return all(
            peer.report.result == result
            for peer in self.peers.values()
            if peer.report.has_joined and peer.state.is_live
        )

    def _next_judgement_us(self, now_us: int) -> int:
        detection_us = self.timing.detection_us
        earliest_us = now_us + detection_us
        for peer in self.peers.values():
            if not peer.state.is_live:
                continue
            for wait_us in (peer.probe_after_us, detection_us, peer.silence_limit_us):
                at_us = peer.last_heard_us + wait_us
                if at_us <= now_us:
                    at_us += detection_us  # it may have been waited for once more
                if now_us < at_us < earliest_us:
                    earliest_us = at_us
        return earliest_us

    def states(self) -> Mapping[str, State]:
        """Robot -> state, sorted by id."""
        return {robot: self.peers[robot].state for robot in sorted(self.peers)}
