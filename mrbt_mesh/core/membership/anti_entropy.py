"""One robot's replica of the facts: what it writes, what it takes in, when it asks for more."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.validation import refusal_reason
from mrbt_mesh.core.membership.timing import NEVER_US, Timing
from mrbt_mesh.core.membership.wire import (
    Header,
    MessageKind,
    ReadBatch,
    WireError,
    decode,
    encode,
    pack_entries,
    parse_entries,
    parse_summary,
    read_batch,
)

# To take in a page takes a robot some milliseconds, in which it does nothing else.
PAGE_BYTES = 1 << 16
# One answer holds all that is lacking; so few are asked, and then, message loss allowing for,
# every `Timing.repair_us` as many more.
QUESTIONS = 3
PAST_DIGESTS = 64


@dataclass(slots=True)
class _Repair:
    """A peer whose facts differ: since when, and since when it was asked.

    `is_behind`: it holds what this replica held before, so it is the one to ask.
    """

    differs_us: int | None = None
    asked_us: int | None = None
    is_behind: bool = False


@dataclass(slots=True)
class Received:
    """What a message brought: entries that changed something, and refusals to count.

    `more`: further pages of the same answer follow.
    """

    changed: list[Entry] = field(default_factory=list)
    refused: int = 0
    reason: str = ""
    has_more: bool = False


class Replica:
    """The facts with this robot's incarnation and sequence number, and the repair of gaps.

    `ask_us` is when somebody may have to be asked for facts (see `due`).
    """

    def __init__(
        self,
        facts: TeamFacts,
        header: Header,
        timing: Timing,
        nonce: str,
        read_batch: ReadBatch = read_batch,
    ) -> None:
        self.facts = facts
        self.header = header
        self.timing = timing
        self.incarnation = Incarnation(0, nonce)
        self._read_batch = read_batch
        self._sequence = 0
        self._repairs: dict[str, _Repair] = {}
        self._past: deque[bytes] = deque(maxlen=PAST_DIGESTS)
        self.next_ask_us = NEVER_US
        # Nobody is to be asked before, if anybody is.
        self._repair_us = 0
        self.changed_us = 0

    @property
    def me(self) -> str:
        return self.header.sender

    def next_incarnation(self, heard: int) -> Incarnation:
        """Take a new incarnation, above this one, all in the facts, and `heard`."""
        known = [e.version.incarnation.counter for e in self.facts.map.of_author(self.me)]
        counter = max([self.incarnation.counter, heard, *known]) + 1
        self.incarnation = Incarnation(counter, self.incarnation.nonce)
        self._sequence = 0
        return self.incarnation

    def restore(self, entries: Iterable[Entry]) -> list[Entry]:
        """Take in what a journal kept; returns what was news."""
        return self._merge(entries, 0, 0).changed

    def write(
        self, values: Iterable[tuple[str, Any]], now_us: int
    ) -> tuple[bytes, tuple[Entry, ...]]:
        """Write one batch of own entries: (the message that tells it, the entries)."""
        self._sequence += 1
        version = Version(self.incarnation, self._sequence)
        entries = [make_entry(self.me, name, version, value) for name, value in values]
        self.facts.map.merge(entries)
        self.changed_us = now_us
        return encode(self.header, MessageKind.FACT, pack_entries(entries)), tuple(entries)

    def find_problem(self, name: str, value: Any) -> str | None:
        """Why this value cannot be written, or None if it can."""
        try:
            make_entry(self.me, name, Version(self.incarnation, self._sequence), value)
        except ValueError as error:
            return str(error)
        return None

    def next_stamp(self) -> int:
        """A Lamport stamp above all that this robot has seen."""
        return self.facts.max_stamp + 1

    def receive(self, source: str, data: bytes, now_us: int) -> Received:
        """Take in a published batch, which may only hold entries of its source.

        Raises WireError.
        """
        entries, malformed = self._read_batch(source, data, self.header)
        return self._merge(entries, malformed, now_us)

    def receive_state(self, data: bytes, now_us: int) -> Received:
        """Take in a page of a peer's answer to a pull: entries of any author. Raises WireError."""
        _, body = decode(data, self.header, MessageKind.STATE)
        if not isinstance(body, list) or len(body) != 2 or not isinstance(body[0], bool):
            raise WireError("state is malformed")
        entries, malformed = parse_entries(body[1])
        received = self._merge(entries, malformed, now_us)
        received.has_more = body[0]
        return received

    def _merge(self, entries: Iterable[Entry], malformed: int, now_us: int) -> Received:
        received = Received(refused=malformed, reason="malformed entry" if malformed else "")
        fitting = []
        for entry in entries:
            reason = refusal_reason(entry, self.facts.mission, self.facts.run)
            if reason is None:
                fitting.append(entry)
            else:
                received.refused += 1
                received.reason = reason
        received.changed = self.facts.map.merge(fitting)
        if received.changed:
            self.changed_us = now_us
        return received

    def write_pull(self) -> bytes:
        """The question for what others have and this replica lacks."""
        return encode(self.header, MessageKind.PULL, self.facts.map.author_digests())

    def answer_pull(self, data: bytes) -> tuple[bytes, ...]:
        """The answer to a pull: all entries of every author where the asker differs.

        In pages that stay far below what a receiver reads; a batch is never torn apart.
        Raises WireError.
        """
        _, body = decode(data, self.header, MessageKind.PULL)
        theirs = parse_summary(body)
        differing = [
            author
            for author, digest in self.facts.map.author_digests().items()
            if theirs.get(author) != digest
        ]
        pages: list[list[Entry]] = [[]]
        size = 0
        for batch in self._batches(differing):
            weight = sum(len(entry.packed) + len(entry.name) for entry in batch)
            if pages[-1] and size + weight > PAGE_BYTES:
                pages.append([])
                size = 0
            pages[-1].extend(batch)
            size += weight
        last = len(pages) - 1
        return tuple(
            encode(self.header, MessageKind.STATE, [number < last, pack_entries(page)])
            for number, page in enumerate(pages)
        )

    def _batches(self, authors: Iterable[str]) -> Iterable[list[Entry]]:
        for author in authors:
            by_version: dict[Version, list[Entry]] = {}
            for entry in self.facts.map.of_author(author):
                by_version.setdefault(entry.version, []).append(entry)
            yield from (by_version[version] for version in sorted(by_version))

    def compare_digest(self, peer: str, digest: bytes, now_us: int) -> None:
        """A peer's beat told the digest of its facts."""
        mine = self.facts.map.digest()
        if not self._past or self._past[-1] != mine:
            self._past.append(mine)
        if digest == mine:
            if self._repairs:
                self.forget(peer)
            return
        repair = self._repairs.get(peer)
        if repair is None:
            repair = self._repairs[peer] = _Repair()
        before = (repair.differs_us, repair.is_behind)
        repair.is_behind = digest in self._past
        if repair.differs_us is None:
            repair.differs_us = now_us
        if before != (repair.differs_us, repair.is_behind):
            self._ask_from(now_us + self.timing.repair_us)

    def peers_to_ask(self, now_us: int) -> list[str]:
        """Peers to ask now: their facts have differed for a while, or their answer is overdue."""
        if now_us < self.next_ask_us:
            return []
        ready = []
        # Who has to wait for others is looked at again soon.
        self._repair_us = self.next_ask_us = now_us + self.timing.ask_timeout_us
        for peer, repair in self._repairs.items():
            deadline_us = self._deadline_us(repair)
            if deadline_us is not None and deadline_us <= now_us:
                ready.append(peer)
                deadline_us = now_us + self.timing.repair_us
            if deadline_us is not None:
                self._ask_from(deadline_us)
        return self.choose_to_ask(ready, now_us)

    def choose_to_ask(self, peers: Iterable[str], now_us: int) -> list[str]:
        """Those of the peers to ask now: few at a time, first who was not asked for longest."""
        just_us = now_us - self.timing.repair_us
        free = QUESTIONS - sum(
            repair.asked_us is not None and repair.asked_us > just_us
            for repair in self._repairs.values()
        )
        waiting = []
        for peer in peers:
            if not self.is_asking(peer, now_us):
                repair = self._repairs.get(peer)
                asked_us = repair.asked_us if repair is not None else None
                waiting.append((asked_us is not None, asked_us or 0, peer))
        return [peer for _, _, peer in sorted(waiting)[: max(0, free)]]

    def mark_asked(self, peer: str, now_us: int) -> None:
        self._repairs.setdefault(peer, _Repair()).asked_us = now_us
        self.next_ask_us = self._repair_us

    def is_asking(self, peer: str, now_us: int) -> bool:
        """Whether an answer of this peer is awaited and not overdue."""
        repair = self._repairs.get(peer)
        if repair is None or repair.asked_us is None:
            return False
        return now_us < repair.asked_us + self.timing.ask_timeout_us

    def mark_answered(self, peer: str) -> None:
        self.forget(peer)

    def mark_unanswered(self, peer: str, now_us: int) -> None:
        """The peer could not be asked: try again soon, it may be only just connecting."""
        repair = self._repairs.get(peer)
        if repair is not None and repair.asked_us is not None:
            retry_us = now_us - self.timing.ask_timeout_us + self.timing.repair_us
            repair.asked_us = min(repair.asked_us, retry_us)
            self._ask_from(now_us + self.timing.repair_us)

    def forget(self, peer: str) -> None:
        """Nothing is wanted of this peer any more: it is repaired, or dead."""
        self._repairs.pop(peer, None)
        if not self._repairs:
            self.next_ask_us = NEVER_US

    def _ask_from(self, at_us: int) -> None:
        self._repair_us = self.next_ask_us = min(self._repair_us, at_us)

    def _deadline_us(self, repair: _Repair) -> int | None:
        if repair.differs_us is None:
            return None
        # What has just changed here is probably on its way there, and the other way round;
        # but a team that is never quiet is repaired all the same.
        wait_us = self.timing.ask_timeout_us if repair.is_behind else self.timing.repair_us
        quiet_us = max(repair.differs_us, self.changed_us) + wait_us
        quiet_us = min(quiet_us, repair.differs_us + max(wait_us, 4 * self.timing.repair_us))
        if repair.asked_us is not None:
            return max(quiet_us, repair.asked_us + self.timing.ask_timeout_us)
        return quiet_us
