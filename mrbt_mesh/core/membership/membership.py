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
from mrbt_mesh.core.membership.wire import Accusation, Beat, Word

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
        self.is_present = name in ("alive", "suspect")
        self.is_distrusted = name in ("suspect", "dead")


@dataclass(slots=True)
class Peer:
    """What is known of one robot's newest incarnation, by its newest `word`.

    `evidence_us` is when a newer beat than before arrived, from itself or relayed; after
    `limit_us` of silence it is dead. After `seek_us` it is `sought`, and left out when agreement is
    counted. `accusers` are the robots that lost its token too, `buriers` those that hold it for
    dead.
    """

    incarnation: Incarnation
    word: Word
    evidence_us: int
    hearing: ArrivalHistory
    limit_us: int
    seek_us: int
    beat: Beat | None = None
    sought: bool = False
    token_lost: bool = False
    state: State = State.ALIVE
    accusers: set[str] = field(default_factory=set)
    buriers: set[str] = field(default_factory=set)


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
        self.changes = 0
        self.hints = 0
        self.reports = 0
        self.at_peace_until_us = 0
        self._judged = -1
        self._accusers: set[str] = set()
        self._distrusted: dict[str, Peer] = {}
        self._limits_us: dict[int, int] = {}

    def is_news(self, row: list[Any]) -> bool:
        """Whether a relay [robot, counter, nonce, number, ...] may tell more than is known."""
        robot, counter, nonce, number = row[:4]
        peer = self.peers.get(robot) if isinstance(robot, str) else None
        if peer is None or type(number) is not int:
            return True
        return number > peer.word.number or (counter, nonce) != peer.incarnation

    def beat(self, robot: str, beat: Beat, now_us: int) -> bool:
        """Take in a beat that came from `robot` itself; False if it is old news."""
        if not self._news(robot, beat.word, now_us, beat):
            return False
        peers, me = self.peers, self.me
        for name, word in beat.heard.items():
            known = peers.get(name)
            # Most relays tell nothing new.
            if known is None:
                if name != me:
                    self._news(name, word, now_us, None)
            elif word is not known.word and (
                word.number > known.word.number or word.incarnation != known.incarnation
            ):
                self._news(name, word, now_us, None)
        if beat.accusations or robot in self._accusers:
            self._take_accusations(robot, beat.accusations)
        return True

    def _take_accusations(self, robot: str, accusations: tuple[Accusation, ...]) -> None:
        """What a robot says of others, in place of what it said before."""
        for accusation in accusations:
            self._accused(robot, accusation)
        accused = {accusation.robot for accusation in accusations}
        for name, peer in self.peers.items():
            if name not in accused and (robot in peer.accusers or robot in peer.buriers):
                peer.accusers.discard(robot)
                peer.buriers.discard(robot)
                self.hints += 1
        if accused:
            self._accusers.add(robot)
        else:
            self._accusers.discard(robot)

    def _news(self, robot: str, word: Word, now_us: int, beat: Beat | None) -> bool:
        """Take in a robot's word, from its own `beat` or else relayed."""
        peer = self.peers.get(robot)
        if peer is None or word.incarnation != peer.incarnation:
            if peer is not None and word.incarnation < peer.incarnation:
                return False
            peer = self._newcomer(robot, word, peer, now_us)
        elif word.number > peer.word.number:
            self._listen(peer, now_us)
        elif beat is not None and word.number == peer.word.number:
            peer.beat = beat
            return peer.state.is_present
        else:
            return False
        before, peer.word, peer.evidence_us = peer.word, word, now_us
        if word.plan_digest != before.plan_digest or word.result != before.result:
            self.reports += 1
        if word.joined != before.joined:
            self.changes += 1
        if beat is not None:
            # Only the robot's own word takes back a lost token: a relay may be older than the loss.
            peer.beat = beat
            if peer.token_lost or peer.accusers:
                peer.token_lost = False
                peer.accusers.clear()
                self.hints += 1
            if beat.leaving:
                self._set(robot, peer, State.LEFT)
            elif not peer.state.is_alive:
                self._set(robot, peer, State.ALIVE)
        elif peer.state is State.DEAD or (peer.state is State.SUSPECT and not peer.token_lost):
            self._set(robot, peer, State.ALIVE)
        return True

    def _newcomer(self, robot: str, word: Word, before: Peer | None, now_us: int) -> Peer:
        """A robot's new life is heard over the same network as the one before."""
        hearing = before.hearing if before is not None else ArrivalHistory.unknown(self.timing)
        limit_us = self._limit_us(hearing.silence_permille)
        self.changes += 1
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
        if peer.state.is_present:
            hearing, limits_us = peer.hearing, self._limits_us
            hearing.gap(now_us - peer.evidence_us, self.timing)
            permille = hearing.silence_permille
            limit_us = limits_us[permille] if permille in limits_us else self._limit_us(permille)
            if limit_us != peer.limit_us:
                peer.limit_us, peer.seek_us = limit_us, limit_us // SEEK_SHARE
        peer.sought = False
        if peer.buriers:
            peer.buriers.clear()
        # The limit may have become shorter.
        seek_at_us = now_us + peer.seek_us
        if seek_at_us < self.at_peace_until_us:
            self.at_peace_until_us = seek_at_us

    def _limit_us(self, silence_permille: int) -> int:
        if silence_permille not in self._limits_us:
            self._limits_us[silence_permille] = self.timing.limit_us(silence_permille)
        return self._limits_us[silence_permille]

    def _accused(self, accuser: str, accusation: Accusation) -> None:
        peer = self.peers.get(accusation.robot)
        if peer is not None and accusation.incarnation == peer.incarnation:
            self.hints += 1
            if accusation.token_lost:
                peer.accusers.add(accuser)
            else:
                peer.accusers.discard(accuser)
            if accusation.dead:
                peer.buriers.add(accuser)
            else:
                peer.buriers.discard(accuser)

    def is_asked(self, beat: Beat, mine: Incarnation) -> bool:
        """Whether the sender seeks a robot of which this one has news: others, or itself."""
        for accusation in beat.accusations:
            if accusation.sought:
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
    def present(self) -> int:
        """How many others there are, neither dead nor gone."""
        return sum(peer.state.is_present for peer in self.peers.values())

    @property
    def is_seeking(self) -> bool:
        """Whether a robot that is not given up has been silent for too long."""
        distrusted = self._distrusted
        return bool(distrusted) and any(peer.sought for peer in distrusted.values())

    def token(self, robot: str, incarnation: Incarnation, held: bool) -> None:
        """A liveliness token came (held) or went. Its presence proves nothing."""
        peer = self.peers.get(robot)
        if peer is not None and peer.incarnation == incarnation:
            peer.token_lost = not held
            self.hints += 1

    def slowed(self, lag_us: int, now_us: int) -> None:
        """This robot itself was late by `lag_us`: messages may wait unread, so blame nobody yet.

        Source: Lifeguard's local health, as a shift of what was last heard.
        """
        for peer in self.peers.values():
            peer.evidence_us = min(now_us, peer.evidence_us + lag_us)

    def is_at_peace(self, now_us: int) -> bool:
        """Whether `judge` would find nothing new."""
        if self._judged != self.changes + self.hints:
            return False
        if now_us < self.at_peace_until_us:
            return True
        if self._distrusted or any(
            peer.state.is_present and now_us - peer.evidence_us >= peer.seek_us
            for peer in self.peers.values()
        ):
            return False
        # Newer evidence has put it off.
        self.at_peace_until_us = self._next_judgement_us(now_us)
        return True

    def judge(self, now_us: int) -> list[tuple[str, State, State]]:
        """Suspect and bury; returns (robot, before, after) for every change."""
        if self.is_at_peace(now_us):
            return []
        before = {robot: peer.state for robot, peer in self.peers.items()}
        silent = 0
        for robot, peer in self.peers.items():
            peer.sought = peer.state.is_present and now_us - peer.evidence_us >= peer.seek_us
            silent += peer.sought
            if peer.sought or (peer.state.is_present and peer.token_lost):
                self._set(robot, peer, State.SUSPECT)
        extra_us = self._extra_us(silent)
        for robot in sorted(self.peers):
            peer = self.peers[robot]
            if peer.state is State.SUSPECT and (
                now_us - peer.evidence_us >= self._patience_us(peer) + extra_us
                or self._everybody_lost(robot, peer)
            ):
                self._set(robot, peer, State.DEAD)
                peer.sought = False
        self._judged = self.changes + self.hints
        self.at_peace_until_us = self._next_judgement_us(now_us)
        return [
            (robot, before[robot], self.peers[robot].state)
            for robot in sorted(before)
            if before[robot] is not self.peers[robot].state
        ]

    def _extra_us(self, silent: int) -> int:
        """When most peers fall silent together, the fault is probably here: wait once more."""
        most = silent > 1 and 2 * silent > self.present
        return self.timing.detection_us if most else 0

    def _patience_us(self, peer: Peer) -> int:
        """The silence after which a suspect is dead: less if another robot has buried it."""
        buried = any(
            other is not None and other.state.is_alive
            for other in map(self.peers.get, peer.buriers)
        )
        return max(self.timing.detection_us, peer.seek_us) if buried else peer.limit_us

    def _everybody_lost(self, robot: str, peer: Peer) -> bool:
        """Whether all others that are in good standing lost this robot's token as well."""
        if not peer.token_lost:
            return False
        witnesses = [
            name
            for name, other in self.peers.items()
            if name != robot and other.word.joined and other.state.is_alive
        ]
        return bool(witnesses) and all(name in peer.accusers for name in witnesses)

    def _set(self, robot: str, peer: Peer, state: State) -> None:
        if peer.state is state:
            return
        peer.state = state
        if state.is_distrusted:
            self._distrusted[robot] = peer
        else:
            self._distrusted.pop(robot, None)
        self.changes += 1

    def alive(self) -> dict[str, Incarnation]:
        """Joined robots that are not dead or gone, suspects included: the plan's alive set."""
        return {
            robot: peer.incarnation
            for robot, peer in sorted(self.peers.items())
            if peer.word.joined and peer.state.is_present
        }

    def accusations(self) -> tuple[Accusation, ...]:
        """What this robot's next beat says of those it does not trust."""
        if not self._distrusted:
            return ()
        return tuple(
            Accusation(
                robot, peer.incarnation, peer.token_lost, peer.state is State.DEAD, peer.sought
            )
            for robot, peer in sorted(self._distrusted.items())
        )

    def heard(self) -> dict[str, Word]:
        """The relays that this robot's next beat carries, sorted by robot."""
        return {
            robot: peer.word for robot, peer in sorted(self.peers.items()) if peer.state.is_alive
        }

    def agrees(self, digest: bytes) -> bool:
        """Whether every robot in good standing reports this plan digest.

        One that is still joining for the first time reports none, so it is waited for too.
        """
        for peer in self.peers.values():
            if peer.state.is_alive and not (peer.word.joined and peer.word.plan_digest == digest):
                return False
        return True

    def all_report(self, result: int) -> bool:
        """Whether every robot of the alive set, suspects included, beats this mission status."""
        return all(
            peer.word.result == result
            for peer in self.peers.values()
            if peer.word.joined and peer.state.is_present
        )

    def _next_judgement_us(self, now_us: int) -> int:
        detection_us = self.timing.detection_us
        earliest_us = now_us + detection_us
        for peer in self.peers.values():
            if not peer.state.is_present:
                continue
            for wait_us in (peer.seek_us, detection_us, peer.limit_us):
                at_us = peer.evidence_us + wait_us
                if at_us <= now_us:
                    at_us += detection_us  # it may have been waited for once more
                if now_us < at_us < earliest_us:
                    earliest_us = at_us
        return earliest_us

    def states(self) -> Mapping[str, State]:
        """Robot -> state, sorted by id."""
        return {robot: self.peers[robot].state for robot in sorted(self.peers)}
