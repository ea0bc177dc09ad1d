"""One robot's replica of the facts: what it writes, what it takes in, what it answers to pulls."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.derived import WITNESSED_KINDS, follows_from_others, is_known
from mrbt_mesh.core.facts.records import MISSION_KINDS, OPERATORS
from mrbt_mesh.core.facts.store import (
    BatchProof,
    Entry,
    Fact,
    Incarnation,
    Version,
    parse_entry,
    part_of,
)
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.validation import refusal_reason
from mrbt_mesh.core.membership.anti_entropy import AntiEntropy
from mrbt_mesh.core.membership.keys import NOT_AUTHENTIC, Authorship, Keys
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.unproved import Unproved
from mrbt_mesh.core.membership.wire import (
    DIGEST_BYTES,
    Header,
    MessageKind,
    ReadBatch,
    SelfReport,
    WireError,
    decode,
    encode,
    pack_entries,
    pack_reports,
    parse_entries,
    parse_pull,
    parse_reports,
    read_batch,
)

TOO_FAR_AHEAD = "its count is too far ahead of those of others"
# To take in a page takes a robot some milliseconds, in which it does nothing else.
PAGE_BYTES = 1 << 16
# A pull has the digests of an author's parts if the author has at least this many entries. Of an
# author with fewer, the answer carries all entries.
PARTED_FROM = 64


@dataclass(slots=True)
class Received:
    """What a message brought: entries that changed something, and refusals to count.

    `has_more`: further pages of the same answer follow. `view`: the robots that are alive for the
    sender.
    """

    changed: list[Entry] = field(default_factory=list)
    refused: int = 0
    reason: str = ""
    has_more: bool = False
    view: Mapping[str, SelfReport] = field(default_factory=dict)


class Replica:
    """The team's facts with this robot's incarnation and sequence number.

    `anti_entropy`: which peers to ask for what may have been missed. `next_version`: that of the
    batch that is written next. `left_out`: own facts that could not be written, and why.
    `unproved`: received facts that wait until something shows them. `shown_by_tick`, of a batch
    with an outcome: the names of its facts that follow from the tick in which the action returned.
    """

    def __init__(
        self,
        facts: TeamFacts,
        header: Header,
        timing: Timing,
        nonce: str,
        read_batch: ReadBatch = read_batch,
        keys: Keys | None = None,
    ) -> None:
        self.facts = facts
        self.header = header
        self.incarnation = Incarnation(0, nonce)
        self.anti_entropy = AntiEntropy(timing)
        self._read_batch = read_batch
        self._keys = keys
        self._authorship = Authorship(keys.was_signed, header.run) if keys is not None else None
        self.next_version = Version(self.incarnation, 1)
        self.left_out: list[str] = []
        self.unproved = Unproved(timing.detection_us if len(facts.declared.robots) > 1 else 0)
        self.shown_by_tick: Callable[[Sequence[Entry]], Collection[str]] = lambda _: ()

    @property
    def me(self) -> str:
        """This robot's id; empty for an observer."""
        return self.header.sender

    def resume(self, version: Version) -> None:
        """Go on with a life whose next batch has this version."""
        self.incarnation, self.next_version = version.incarnation, version

    # -- writing ------------------------------------------------------------------------------

    def next_incarnation(self, heard: int) -> Incarnation:
        """Take a new incarnation, counted above the present one, all in the facts, and `heard`."""
        known = [e.version.incarnation.counter for e in self.facts.map.of_author(self.me)]
        counter = max([self.incarnation.counter, heard, *known]) + 1
        self.incarnation = Incarnation(counter, self.incarnation.nonce)
        self.next_version = Version(self.incarnation, 1)
        return self.incarnation

    def write(self, facts: Iterable[Fact], now_us: int) -> tuple[bytes, tuple[Entry, ...]]:
        """Write one batch of own facts: (the message with it, its entries).

        A fact that other robots and this robot's own journal would refuse is left out.
        """
        version = self.next_version
        self.next_version = Version(self.incarnation, version.sequence + 1)
        proof = BatchProof() if self._keys is not None else None
        entries = []
        for name, record in facts:
            try:
                entries.append(parse_entry(self.me, name, version, record.to_value(), proof))
            except ValueError as error:
                self.left_out.append(f"{name}: {error}")
        if entries and proof is not None and self._keys and self._authorship is not None:
            self._authorship.sign(proof, entries, self._keys.sign)
        self.facts.map.merge(entries)
        self.anti_entropy.changed_us = now_us
        return encode(self.header, MessageKind.FACT, pack_entries(entries)), tuple(entries)

    def is_authentic(self, entry: Entry) -> bool:
        """Whether the author of an entry has signed it; without keys everybody is believed."""
        return self._authorship is None or self._authorship.is_authentic(entry)

    def take_command(self, entry: Entry, now_us: int) -> bytes:
        """Take in an authentic command, which an operator gives to this robot: the message with it
        for the others.
        """
        self.facts.map.merge([entry])
        self.anti_entropy.changed_us = now_us
        return encode(self.header, MessageKind.FACT, pack_entries([entry]))

    def follow_keys(self, alive: Collection[str]) -> None:
        """Facts of robots without a key in good standing say nothing, once these are not alive.

        They stay in the map, so robots that learn of that at different times still have the same.
        """
        keys = self._keys
        if keys is not None:
            authors = (a for a in self.facts.map.authors() if a not in alive and a != OPERATORS)
            self.facts.set_revoked(frozenset(a for a in authors if keys.role_of(a) is None))

    # -- taking in ----------------------------------------------------------------------------

    def restore(self, entries: Iterable[Entry]) -> list[Entry]:
        """Take in what a journal kept; returns what was news."""
        return self._merge(entries, 0, 0, "", is_own_record=True).changed

    def take_shown(
        self, is_shown: Callable[[Entry], bool], membership: Membership, now_us: int
    ) -> list[Entry]:
        """Take in the facts that were unproved and are shown now; returns what was news.

        Among them is what a robot saw while it was not heard.
        """

        def counts(entry: Entry) -> bool:
            has_seen = entry.parts[0] in WITNESSED_KINDS
            return (has_seen and membership.has_returned(entry.author, now_us)) or is_shown(entry)

        taken = self.unproved.take(counts, membership.in_reach(now_us), now_us)
        changed = self.facts.map.merge(taken)
        if changed:
            self.anti_entropy.changed_us = now_us
        return changed

    def next_unproved_us(self, membership: Membership, now_us: int) -> int | None:
        """When an unproved fact may have to be taken in all the same; None if none has."""
        if not self.unproved:
            return None
        return self.unproved.next_us(membership.in_reach(now_us), now_us)

    def receive(self, source: str, data: bytes, now_us: int) -> Received:
        """Take in a published batch, which may only hold entries of its source, or commands.

        Raises WireError.
        """
        entries, malformed = self._read_batch(source, data, self.header)
        return self._merge(entries, malformed, now_us, source)

    def receive_state(self, source: str, data: bytes, now_us: int) -> Received:
        """Take in a page of a peer's answer to a pull: entries of any author. Raises WireError.

        `source`: the peer that is proved to have sent it.
        """
        _, body = decode(data, self.header, MessageKind.STATE)
        if not isinstance(body, list) or len(body) != 3 or not isinstance(body[0], bool):
            raise WireError("state is malformed")
        entries, malformed = parse_entries(body[1])
        view = parse_reports(body[2])
        received = self._merge(entries, malformed, now_us, source)
        received.has_more = body[0]
        received.view = view
        return received

    def _merge(
        self,
        entries: Iterable[Entry],
        malformed: int,
        now_us: int,
        source: str,
        is_own_record: bool = False,
    ) -> Received:
        received = Received(refused=malformed, reason="malformed entry" if malformed else "")
        entries = list(entries)
        # What else there is may have a place only in a revision of the mission that comes with it.
        missions = [entry for entry in entries if entry.parts[0] in MISSION_KINDS]
        if missions:
            self._merge_some(missions, received, source, is_own_record)
            entries = [entry for entry in entries if entry.parts[0] not in MISSION_KINDS]
        self._merge_some(entries, received, source, is_own_record)
        if received.changed:
            self.anti_entropy.changed_us = now_us
        return received

    def _merge_some(
        self, entries: Sequence[Entry], received: Received, source: str, is_own_record: bool
    ) -> None:
        fitting, shown = [], None
        for entry in entries:
            reason = refusal_reason(entry, self.facts.declared, self.facts.run)
            if reason is None and not is_own_record and not self._is_authentic(entry):
                reason = NOT_AUTHENTIC
            if reason is None and not is_own_record and self.facts.is_too_far_ahead(entry):
                reason = TOO_FAR_AHEAD
            if reason is None and not is_own_record and self._needs_proof(entry):
                if shown is None:
                    shown = self.shown_by_tick(entries)
                if entry.name not in shown and not self.unproved.add(entry, source):
                    continue
            if reason is None:
                fitting.append(entry)
            else:
                received.refused += 1
                received.reason = reason
        received.changed += self.facts.map.merge(fitting)

    def _needs_proof(self, entry: Entry) -> bool:
        if entry.author == self.me or not follows_from_others(entry):
            return False
        mine = self.facts.map.get(entry.author, entry.name)
        return (mine is None or mine.hash != entry.hash) and not is_known(self.facts, entry)

    def _is_authentic(self, entry: Entry) -> bool:
        if self._authorship is None:
            return True
        mine = self.facts.map.get(entry.author, entry.name)
        is_held = mine is not None and mine.hash == entry.hash
        return is_held or self.is_authentic(entry)

    # -- pulls --------------------------------------------------------------------------------

    def compare_digest(
        self, peer: str, digest: bytes, now_us: int, mine: bytes | None = None
    ) -> None:
        """A peer's heartbeat has the digest of its facts.

        `mine`: what to compare it with, if it is over more than the facts.
        """
        own = self.facts.map.digest() if mine is None else mine
        self.anti_entropy.compare(peer, digest, own, now_us)

    def peers_to_ask(self, now_us: int, more: Collection[bytes] = (b"",)) -> list[str]:
        """The peers to ask now; `more`: what the digests of equal facts may be followed by."""
        if now_us < self.anti_entropy.next_ask_us:
            return []
        own = self.facts.map.digest()
        return self.anti_entropy.peers_to_ask(now_us, [own + each for each in more])

    def write_pull(self, alive: bytes = bytes(DIGEST_BYTES)) -> bytes:
        """The question for what others have and this replica lacks; `alive`: of its alive set."""
        facts = self.facts.map
        digests = facts.author_digests()
        parted = [author for author in digests if facts.count_of(author) >= PARTED_FROM]
        parts = {author: facts.part_digests(author) for author in parted}
        return encode(self.header, MessageKind.PULL, [digests, alive, parts])

    def answer_pull(
        self, data: bytes, view: Callable[[bytes], Mapping[str, SelfReport]] | None = None
    ) -> tuple[bytes, ...]:
        """The answer to a pull: all entries of every author where the asker differs; of one of whom
        it has many, those of the parts that differ.

        In pages that stay far below what a receiver reads; a batch is never torn apart. `view`,
        of the digest of the asker's alive set: the robots that are held for alive here, if that is
        others; it goes with the last one. Raises WireError.
        """
        _, body = decode(data, self.header, MessageKind.PULL)
        theirs, alive, parts = parse_pull(body)
        differing = [
            author
            for author, digest in self.facts.map.author_digests().items()
            if theirs.get(author) != digest
        ]
        pages: list[list[Entry]] = [[]]
        size = 0
        for batch in self._batches(differing, parts):
            batch_bytes = sum(len(entry.packed) + len(entry.name) for entry in batch)
            if pages[-1] and size + batch_bytes > PAGE_BYTES:
                pages.append([])
                size = 0
            pages[-1].extend(batch)
            size += batch_bytes
        last, reports = len(pages) - 1, pack_reports(view(alive) if view is not None else {})
        return tuple(
            encode(
                self.header,
                MessageKind.STATE,
                [
                    number < last,
                    pack_entries(page),
                    reports if number == last else [],
                ],
            )
            for number, page in enumerate(pages)
        )

    def _batches(self, authors: Iterable[str], parts: Mapping[str, bytes]) -> Iterable[list[Entry]]:
        for author in authors:
            wanted = self._differing_parts(author, parts.get(author))
            by_version: dict[Version, list[Entry]] = {}
            for entry in self.facts.map.of_author(author):
                if wanted is None or part_of(entry.version) in wanted:
                    by_version.setdefault(entry.version, []).append(entry)
            yield from (by_version[version] for version in sorted(by_version))

    def _differing_parts(self, author: str, theirs: bytes | None) -> frozenset[int] | None:
        """The parts of an author's entries to send; None: all."""
        if theirs is None:
            return None
        mine = self.facts.map.part_digests(author)
        # Two digests may be equal by chance; the author's own, which is longer, is not.
        at = range(0, len(mine), 8)
        return frozenset(n // 8 for n in at if mine[n : n + 8] != theirs[n : n + 8]) or None


class Durability:
    """What this robot's journal is known to hold: promises to others are made from the disk alone.

    It numbers what must be on disk, and knows up to which number all is.
    `problem`: what is wrong with the journal, for people; empty if nothing is. `is_failing`: it
    cannot be written now. `keeps_journal`: there is one, so it is worth waiting for.
    """

    def __init__(
        self, problem: str = "", is_failing: bool = False, keeps_journal: bool = True
    ) -> None:
        self.problem = problem
        self.is_failing = is_failing
        self.keeps_journal = keeps_journal
        self._last = 0
        self._synced = 0
        # Before this number is on disk, nothing else is known to be.
        self._whole_from = 0

    @property
    def may_promise(self) -> bool:
        """Whether what is written now will be on disk soon, with all that was said before."""
        return not self.is_failing and self._synced >= self._whole_from

    def take_number(self) -> int:
        """The number of what is written next."""
        self._last += 1
        return self._last

    def begin_anew(self) -> int:
        """The journal may have lost anything: the number of everything, written once more."""
        self._whole_from = self.take_number()
        return self._whole_from

    def note_synced(self, number: int) -> None:
        """Everything up to this number is on disk."""
        self._synced = max(self._synced, number)

    def is_on_disk(self, number: int) -> bool:
        """Whether this and all before it are on disk."""
        return self._synced >= max(number, self._whole_from)
