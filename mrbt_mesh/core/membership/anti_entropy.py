"""Anti-entropy: which peers to ask for their facts, and when.

Every heartbeat has a digest of its sender's facts. If it differs from this robot's digest for
longer than a message may take, facts were lost on the way, and the peer is asked for them
(`replica` writes and answers the pulls). Few peers are asked at a time, as one answer holds all
that is missing. A peer whose digest is one that this replica had earlier is asked later, since it
will ask by itself, and not at all while it catches up. Nor is a peer asked if this replica has had
the peer's digest since its last heartbeat. Where answers take long because all robots are busy,
facts take long too: then a difference may last longer before it counts as a loss, and while no
answers come, ever fewer peers are asked.

Source: Demers et al., Epidemic algorithms for replicated database maintenance, 1987.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from mrbt_mesh.core.membership.timing import NEVER_US, Timing

# The number of peers asked per `Timing.repair_us`; another round follows, as messages may get lost.
PULLS_AT_A_TIME = 3
# After this many unanswered pulls the wait is doubled; the maximum number of doublings.
IN_VAIN, MAX_DOUBLED = 2 * PULLS_AT_A_TIME, 4
# A message may take this many times as long as recent answers took.
PATIENCE = 2
PAST_DIGESTS = 64


@dataclass(slots=True)
class _Difference:
    """A peer whose facts differ: when its last heartbeat came and with which digest, since when the
    facts differ, and when the peer was asked last.

    `is_behind`: its digest is one that this replica had before, so the peer is the one to ask.
    """

    heard_us: int
    digest: bytes = b""
    since_us: int | None = None
    asked_us: int | None = None
    is_behind: bool = False


class AntiEntropy:
    """The peers of one replica whose facts differ from its own.

    `next_ask_us`: when a peer may have to be asked (see `peers_to_ask`). `changed_us`: when this
    replica's own facts last changed.
    """

    def __init__(self, timing: Timing) -> None:
        self.next_ask_us = NEVER_US
        self._timing = timing
        self._differences: dict[str, _Difference] = {}
        self._past_digests: deque[bytes] = deque(maxlen=PAST_DIGESTS)
        # No peer has to be asked before this time.
        self._not_before_us = 0
        self.changed_us = 0
        self._asked_in_vain = 0
        # How long answers take, smoothed.
        self._answer_us = 0

    @property
    def _repair_us(self) -> int:
        return max(self._timing.repair_us, PATIENCE * self._answer_us) << self._doubled

    @property
    def _ask_timeout_us(self) -> int:
        return max(self._timing.ask_timeout_us, PATIENCE * self._answer_us) << self._doubled

    @property
    def _doubled(self) -> int:
        return min(MAX_DOUBLED, self._asked_in_vain // IN_VAIN)

    def allow_for_own_lag(self, lag_us: int) -> None:
        """Allow for this robot having been late by `lag_us`: facts and answers may wait unread."""
        self.changed_us += lag_us
        for difference in self._differences.values():
            difference.heard_us += lag_us
            if difference.since_us is not None:
                difference.since_us += lag_us
            if difference.asked_us is not None:
                difference.asked_us += lag_us

    def compare(self, peer: str, digest: bytes, mine: bytes, now_us: int) -> None:
        """Compare the digest in a peer's heartbeat with `mine`, that of this replica's facts."""
        if not self._past_digests or self._past_digests[-1] != mine:
            self._past_digests.append(mine)
        if digest == mine:
            if self._differences:
                self.forget(peer)
            return
        difference = self._differences.get(peer)
        if difference is None:
            difference = self._differences[peer] = _Difference(now_us)
        before = (difference.since_us, difference.is_behind)
        has_caught_up = self._has_had(difference)
        difference.is_behind = digest in self._past_digests
        has_caught_up |= difference.is_behind and digest != difference.digest
        difference.heard_us, difference.digest = now_us, digest
        if difference.since_us is None or has_caught_up:
            difference.since_us = now_us
        if before != (difference.since_us, difference.is_behind):
            self._ask_from(now_us + self._repair_us)

    def peers_to_ask(self, now_us: int, mine: Collection[bytes] = ()) -> list[str]:
        """The peers to ask now: their facts have differed for a while, or their answer is overdue.

        `mine`: the digests that the heartbeat of a peer with equal facts would have now. What a
        peer had at its last heartbeat may have arrived since.
        """
        if now_us < self.next_ask_us:
            return []
        self._past_digests.extend(mine)
        for peer, difference in list(self._differences.items()):
            is_equal = difference.digest in mine or self._has_had(difference)
            if is_equal or self._is_outdated(difference, now_us):
                self.forget(peer)
        if not self._differences:
            return []
        due = []
        # Peers that have to wait for others are looked at again soon.
        self._not_before_us = self.next_ask_us = now_us + self._ask_timeout_us
        for peer, difference in self._differences.items():
            deadline_us = self._deadline_us(difference)
            if deadline_us is not None and deadline_us <= now_us:
                due.append(peer)
                deadline_us = now_us + self._repair_us
            if deadline_us is not None:
                self._ask_from(deadline_us)
        return self.choose_to_ask(due, now_us)

    def choose_to_ask(self, peers: Iterable[str], now_us: int) -> list[str]:
        """Choose the peers to ask now: few at a time, those not asked for longest first."""
        just_us = now_us - self._repair_us
        free = PULLS_AT_A_TIME - sum(
            difference.asked_us is not None and difference.asked_us > just_us
            for difference in self._differences.values()
        )
        waiting = []
        for peer in peers:
            if not self.is_asking(peer, now_us):
                difference = self._differences.get(peer)
                asked_us = difference.asked_us if difference is not None else None
                waiting.append((asked_us is not None, asked_us or 0, peer))
        return [peer for _, _, peer in sorted(waiting)[: max(0, free)]]

    def is_asking(self, peer: str, now_us: int) -> bool:
        """True if an answer of this peer is awaited and not overdue."""
        difference = self._differences.get(peer)
        if difference is None or difference.asked_us is None:
            return False
        return now_us < difference.asked_us + self._ask_timeout_us

    def mark_asked(self, peer: str, now_us: int) -> None:
        """Note that a pull is sent to this peer."""
        self._differences.setdefault(peer, _Difference(now_us)).asked_us = now_us
        self.next_ask_us = self._not_before_us
        self._asked_in_vain += 1

    def mark_answered(self, peer: str, now_us: int) -> None:
        """Note that the last page of this peer's answer has arrived.

        Forgets differences of other peers whose last heartbeat is overdue, as the answer may have
        resolved them. If it did not, some robot finds them again.
        """
        asked = self._differences.get(peer)
        if asked is not None and asked.asked_us is not None:
            self._answer_us = (3 * self._answer_us + now_us - asked.asked_us) // 4
        self.forget(peer)
        # Halved, not reset: one answer among many unanswered pulls does not show that peers have
        # time.
        self._asked_in_vain //= 2
        before_us = now_us - self._timing.overdue_us
        for other, difference in list(self._differences.items()):
            if difference.heard_us < before_us and not self.is_asking(other, now_us):
                self.forget(other)

    def mark_unanswered(self, peer: str, now_us: int) -> None:
        """Note that there is no answer. If that was quick, the peer could not be asked and may be
        just connecting: try again soon. Otherwise it is too slow, and the usual timeout applies.
        """
        difference = self._differences.get(peer)
        if difference is None or difference.asked_us is None:
            return
        if now_us < difference.asked_us + self._timing.repair_us:
            retry_us = now_us - self._timing.ask_timeout_us + self._timing.repair_us
            difference.asked_us = min(difference.asked_us, retry_us)
            self._ask_from(now_us + self._timing.repair_us)

    def forget(self, peer: str) -> None:
        """Forget a peer's difference: its facts are equal or outdated, or it is dead."""
        self._differences.pop(peer, None)
        if not self._differences:
            self.next_ask_us = NEVER_US

    def _ask_from(self, at_us: int) -> None:
        self._not_before_us = self.next_ask_us = min(self._not_before_us, at_us)

    def _has_had(self, difference: _Difference) -> bool:
        """True if this replica already had the facts that the peer advertised in its last
        heartbeat.
        """
        return not difference.is_behind and difference.digest in self._past_digests

    def _is_outdated(self, difference: _Difference, now_us: int) -> bool:
        """True if facts have changed since the peer's last heartbeat, which is overdue.

        If the facts still differ, neighbours of this robot or of the peer find out.
        """
        is_overdue = now_us >= difference.heard_us + self._timing.overdue_us
        return self.changed_us > difference.heard_us and is_overdue

    def _deadline_us(self, difference: _Difference) -> int | None:
        """Return when to ask, or None. A recent change here is probably on its way to the peer, and
        the other way round. If facts changed after the peer's last heartbeat, its next one shows
        whether they still differ. The wait is bounded, so a team whose facts always change is
        repaired too.
        """
        if difference.since_us is None:
            return None
        wait_us = self._ask_timeout_us if difference.is_behind else self._repair_us
        calm_us = max(difference.since_us, self.changed_us) + wait_us
        if self.changed_us > difference.heard_us:
            calm_us = max(calm_us, difference.heard_us + self._timing.overdue_us)
        calm_us = min(calm_us, difference.since_us + max(wait_us, 4 * self._repair_us))
        if difference.asked_us is not None:
            return max(calm_us, difference.asked_us + self._ask_timeout_us)
        return calm_us
