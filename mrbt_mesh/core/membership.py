"""Who is alive: beats decide, liveliness tokens hint, others are heard before a verdict.

Every beat relays the newest beats that its sender knows, and its suspicions. That is SWIM's
indirect probe without a question: a robot that anybody still hears is alive for everybody,
and a robot whose token everybody lost at once is dead without waiting for a timeout. Death is
a local judgement about one incarnation; a newer beat of it revives it.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.facts import Incarnation
from mrbt_mesh.core.timing import Timing
from mrbt_mesh.core.wire import Accusation, Beat, Heard


class State(enum.StrEnum):
    """A robot as another one sees it. LEFT: gone on purpose."""

    ALIVE = "alive"
    SUSPECT = "suspect"
    DEAD = "dead"
    LEFT = "left"


@dataclass(slots=True)
class Peer:
    """What is known of one robot's newest incarnation.

    `evidence_us` is when a newer beat than before arrived, from itself or relayed; `accusers`
    are the robots that lost its token too.
    """

    incarnation: Incarnation
    number: int
    evidence_us: int
    plan_digest: bytes
    joined: bool
    result: int
    beat: Beat | None = None
    token_lost: bool = False
    state: State = State.ALIVE
    accusers: set[str] = field(default_factory=set)


class Membership:
    """One robot's view of the others. `me` never appears in it."""

    def __init__(self, me: str, timing: Timing) -> None:
        self.me = me
        self.timing = timing
        self.peers: dict[str, Peer] = {}
        self.changes = 0
        # Until then, and while nothing below changes, `judge` would say nothing new.
        self._at_peace_until_us = 0
        self._hints = 0
        self._judged = (-1, -1)

    def is_news(self, row: list[Any]) -> bool:
        """Whether a relay [robot, counter, nonce, number, ...] may tell more than is known."""
        robot, counter, nonce, number = row[:4]
        peer = self.peers.get(robot) if isinstance(robot, str) else None
        if peer is None or type(number) is not int:
            return True
        return number > peer.number or (counter, nonce) != peer.incarnation

    def beat(self, robot: str, beat: Beat, now_us: int) -> bool:
        """Take in a beat that came from `robot` itself; False if it is old news."""
        own = Heard(
            robot, beat.incarnation, beat.number, beat.plan_digest, beat.joined, beat.result
        )
        if not self._news(own, now_us, beat):
            return False
        for heard in beat.heard:
            if heard.robot != self.me:
                self._news(heard, now_us, None)
        for accusation in beat.accusations:
            self._accused(robot, accusation)
        accused = {accusation.robot for accusation in beat.accusations}
        for name, peer in self.peers.items():
            if robot in peer.accusers and name not in accused:
                peer.accusers.discard(robot)
                self._hints += 1
        return True

    def _news(self, heard: Heard, now_us: int, beat: Beat | None) -> bool:
        """Take in a robot's word: its own `beat`, or else the relay of one."""
        peer = self.peers.get(heard.robot)
        age = (heard.incarnation, heard.number)
        if peer is not None and age <= (peer.incarnation, peer.number):
            if beat is not None and age == (peer.incarnation, peer.number):
                peer.beat = beat
                return peer.state not in (State.DEAD, State.LEFT)
            return False
        if peer is None or heard.incarnation != peer.incarnation:
            peer = Peer(
                heard.incarnation,
                heard.number,
                now_us,
                heard.plan_digest,
                heard.joined,
                heard.result,
            )
            self.peers[heard.robot] = peer
            self.changes += 1
        peer.number, peer.evidence_us = heard.number, now_us
        peer.plan_digest, peer.result = heard.plan_digest, heard.result
        if heard.joined != peer.joined:
            peer.joined = heard.joined
            self.changes += 1
        if beat is not None:
            # Only the robot's own word takes back a lost token: a relay may be older than the loss.
            peer.beat = beat
            if peer.token_lost or peer.accusers:
                peer.token_lost = False
                peer.accusers.clear()
                self._hints += 1
            self._set(peer, State.LEFT if beat.leaving else State.ALIVE)
        elif peer.state is State.DEAD or (peer.state is State.SUSPECT and not peer.token_lost):
            self._set(peer, State.ALIVE)
        return True

    def _accused(self, accuser: str, accusation: Accusation) -> None:
        peer = self.peers.get(accusation.robot)
        if peer is not None and accusation.incarnation == peer.incarnation:
            self._hints += 1
            if accusation.token_lost:
                peer.accusers.add(accuser)
            else:
                peer.accusers.discard(accuser)

    def token(self, robot: str, incarnation: Incarnation, held: bool) -> None:
        """A liveliness token came (held) or went. Its presence proves nothing."""
        peer = self.peers.get(robot)
        if peer is not None and peer.incarnation == incarnation:
            peer.token_lost = not held
            self._hints += 1

    def slowed(self, lag_us: int, now_us: int) -> None:
        """This robot itself was late by `lag_us`: messages may wait unread, so blame nobody yet.

        Source: Lifeguard's local health, as a shift of what was last heard.
        """
        for peer in self.peers.values():
            peer.evidence_us = min(now_us, peer.evidence_us + lag_us)

    def judge(self, now_us: int) -> list[tuple[str, State, State]]:
        """Suspect and bury; returns (robot, before, after) for every change."""
        if now_us < self._at_peace_until_us and self._judged == (self.changes, self._hints):
            return []
        before = {robot: peer.state for robot, peer in self.peers.items()}
        silent = 0
        for peer in self.peers.values():
            quiet_us = now_us - peer.evidence_us
            if peer.state not in (State.DEAD, State.LEFT):
                silent += quiet_us >= self.timing.suspect_us
                if quiet_us >= self.timing.suspect_us or peer.token_lost:
                    self._set(peer, State.SUSPECT)
        limit_us = self._limit_us(silent)
        for robot in sorted(self.peers):
            peer = self.peers[robot]
            if peer.state is State.SUSPECT and (
                now_us - peer.evidence_us >= limit_us or self._everybody_lost(robot, peer)
            ):
                self._set(peer, State.DEAD)
        self._judged = (self.changes, self._hints)
        self._at_peace_until_us = self._next_judgement_us(now_us)
        return [
            (robot, before[robot], self.peers[robot].state)
            for robot in sorted(before)
            if before[robot] is not self.peers[robot].state
        ]

    def _limit_us(self, silent: int) -> int:
        """When most peers fall silent together, the fault is probably here: wait once more."""
        present = sum(p.state not in (State.DEAD, State.LEFT) for p in self.peers.values())
        return self.timing.detection_us * (2 if silent > 1 and 2 * silent > present else 1)

    def _everybody_lost(self, robot: str, peer: Peer) -> bool:
        """Whether all others that are in good standing lost this robot's token as well."""
        if not peer.token_lost:
            return False
        witnesses = [
            name
            for name, other in self.peers.items()
            if name != robot and other.joined and other.state is State.ALIVE
        ]
        return bool(witnesses) and all(name in peer.accusers for name in witnesses)

    def _set(self, peer: Peer, state: State) -> None:
        if peer.state is not state:
            peer.state = state
            self.changes += 1

    def alive(self) -> dict[str, Incarnation]:
        """Joined robots that are not dead or gone, suspects included: the plan's alive set."""
        return {
            robot: self.peers[robot].incarnation
            for robot in sorted(self.peers)
            if self.peers[robot].joined and self.peers[robot].state in (State.ALIVE, State.SUSPECT)
        }

    def accusations(self) -> tuple[Accusation, ...]:
        """What this robot's next beat says of those it does not trust."""
        return tuple(
            Accusation(robot, peer.incarnation, peer.token_lost, peer.state is State.DEAD)
            for robot, peer in sorted(self.peers.items())
            if peer.state in (State.SUSPECT, State.DEAD)
        )

    def heard(self) -> tuple[Heard, ...]:
        """The relays that this robot's next beat carries."""
        return tuple(
            Heard(robot, peer.incarnation, peer.number, peer.plan_digest, peer.joined, peer.result)
            for robot, peer in sorted(self.peers.items())
            if peer.state is State.ALIVE
        )

    def agrees(self, digest: bytes) -> bool:
        """Whether every robot in good standing reports this plan digest.

        One that is still joining for the first time reports none, so it is waited for too.
        """
        return all(
            peer.joined and peer.plan_digest == digest
            for peer in self.peers.values()
            if peer.state is State.ALIVE
        )

    def all_report(self, result: int) -> bool:
        """Whether every robot of the alive set, suspects included, beats this mission status."""
        return all(self.peers[robot].result == result for robot in self.alive())

    def next_deadline_us(self, now_us: int) -> int:
        """When, after `now_us`, `judge` may come to another answer without any message.

        Newer evidence may have put it off meanwhile.
        """
        if now_us >= self._at_peace_until_us:
            return self._next_judgement_us(now_us)
        return self._at_peace_until_us

    def _next_judgement_us(self, now_us: int) -> int:
        suspect_us, detection_us = self.timing.suspect_us, self.timing.detection_us
        earliest_us = now_us + detection_us
        for peer in self.peers.values():
            if peer.state in (State.DEAD, State.LEFT):
                continue
            for wait_us in (suspect_us, detection_us, 2 * detection_us):
                if peer.evidence_us + wait_us > now_us:
                    earliest_us = min(earliest_us, peer.evidence_us + wait_us)
                    break
        return earliest_us

    def states(self) -> Mapping[str, State]:
        """Robot -> state, sorted by id."""
        return {robot: self.peers[robot].state for robot in sorted(self.peers)}
