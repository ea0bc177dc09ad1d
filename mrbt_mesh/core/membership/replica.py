"""One robot's replica of the facts: what it writes, what it merges, and its answers to pulls."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.derived import WITNESSED_KINDS, follows_from_others, is_known
from mrbt_mesh.core.facts.records import IN_ANY_MISSION, OPERATORS
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
# Merging a page takes some milliseconds, in which a robot does nothing else.
PAGE_BYTES = 1 << 16
# A pull has digests of an author's parts if the author has at least this many entries. For other
# authors the answer carries all entries.
PARTED_FROM = 64


@dataclass(slots=True)
class Received:
    """The result of a message: entries that changed something, and the number of refused ones.

    `reason`: why the last one was refused. `has_more`: further pages of the same answer follow.
    `view`: the self-reports of the robots that are alive for the sender.
    """

    changed: list[Entry] = field(default_factory=list)
    refused: int = 0
    reason: str = ""
    has_more: bool = False
    view: Mapping[str, SelfReport] = field(default_factory=dict)


class Replica:
    """The team's facts, and this robot's incarnation and sequence number.

    `anti_entropy`: which peers to ask for facts that may have been missed. `next_version`: the
    version of the next batch. `left_out`: own facts that could not be written, and why. `unproved`:
    received facts that wait for proof. `shown_by_tick(entries)`: for a batch with an outcome, the
    names of its facts that follow from the tick in which the action returned.
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
        self.unproved = Unproved(timing.detection_us if len(facts.in_force.robots) > 1 else 0)
        self.shown_by_tick: Callable[[Sequence[Entry]], Collection[str]] = lambda _: ()

    @property
    def me(self) -> str:
        """This robot's id; empty for an observer."""
        return self.header.sender

    def resume(self, version: Version) -> None:
        """Continue the incarnation whose next batch has this version."""
        self.incarnation, self.next_version = version.incarnation, version

    # -- writing ------------------------------------------------------------------------------

    def next_incarnation(self, heard: int) -> Incarnation:
        """Take a new incarnation, counted above the present one, `heard`, and all in the facts."""
        known = [e.version.incarnation.counter for e in self.facts.map.of_author(self.me)]
        counter = max([self.incarnation.counter, heard, *known]) + 1
        self.incarnation = Incarnation(counter, self.incarnation.nonce)
        self.next_version = Version(self.incarnation, 1)
        return self.incarnation

    def write(self, facts: Iterable[Fact], now_us: int) -> tuple[bytes, tuple[Entry, ...]]:
        """Write one batch of own facts. Returns (message, entries).

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
        """True if the author of an entry has signed it, or if the team has no keys."""
        return self._authorship is None or self._authorship.is_authentic(entry)

    def take_command(self, entry: Entry, now_us: int) -> bytes:
        """Merge an authentic command that an operator gives to this robot. Returns the message that
        passes it on to the other robots.
        """
        self.facts.map.merge([entry])
        self.anti_entropy.changed_us = now_us
        return encode(self.header, MessageKind.FACT, pack_entries([entry]))

    def follow_keys(self, alive: Collection[str]) -> None:
        """Ignore the facts of authors whose key is not (or no longer) valid, unless they are alive.

        The facts stay in the map, so robots that learn of a revocation at different times still
        have equal maps.
        """
        keys = self._keys
        if keys is not None:
            authors = (a for a in self.facts.map.authors() if a not in alive and a != OPERATORS)
            self.facts.set_revoked(frozenset(a for a in authors if keys.role_of(a) is None))

    # -- taking in ----------------------------------------------------------------------------

    def restore(self, entries: Iterable[Entry]) -> list[Entry]:
        """Merge what the journal kept. Returns the entries that were news."""
        return self._merge(entries, 0, 0, "", is_own_record=True).changed

    def take_shown(
        self, is_shown: Callable[[Entry], bool], membership: Membership, now_us: int
    ) -> list[Entry]:
        """Merge unproved facts that are proved now. Returns the entries that were news.

        Includes what a robot witnessed while it was not heard.
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
        """When an unproved fact may have to be merged without proof; None if there is none."""
        if not self.unproved:
            return None
        return self.unproved.next_us(membership.in_reach(now_us), now_us)

    def receive(self, source: str, data: bytes, now_us: int) -> Received:
        """Merge a published batch, which may only hold entries of its source, or commands.

        Raises WireError.
        """
        entries, malformed = self._read_batch(source, data, self.header)
        return self._merge(entries, malformed, now_us, source)

    def receive_state(self, source: str, data: bytes, now_us: int) -> Received:
        """Merge a page of a peer's answer to a pull: entries of any author. Raises WireError.

        `source`: the authenticated sender.
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
        # Other entries may be valid only under a mission that comes with them.
        missions = [entry for entry in entries if entry.parts[0] in IN_ANY_MISSION]
        if missions:
            self._merge_some(missions, received, source, is_own_record)
            entries = [entry for entry in entries if entry.parts[0] not in IN_ANY_MISSION]
        self._merge_some(entries, received, source, is_own_record)
        if received.changed:
            self.anti_entropy.changed_us = now_us
        return received

    def _merge_some(
        self, entries: Sequence[Entry], received: Received, source: str, is_own_record: bool
    ) -> None:
        fitting, shown = [], None
        for entry in entries:
            reason = refusal_reason(entry, self.facts.in_force, self.facts.run)
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
        """Compare facts by the digest in a peer's heartbeat.

        `mine`: the digest to compare it with, if it covers more than the facts.
        """
        own = self.facts.map.digest() if mine is None else mine
        self.anti_entropy.compare(peer, digest, own, now_us)

    def peers_to_ask(self, now_us: int, more: Collection[bytes] = (b"",)) -> list[str]:
        """The peers to ask now. `more`: the suffixes that the digest of equal facts may have."""
        if now_us < self.anti_entropy.next_ask_us:
            return []
        own = self.facts.map.digest()
        return self.anti_entropy.peers_to_ask(now_us, [own + each for each in more])

    def write_pull(self, alive: bytes = bytes(DIGEST_BYTES)) -> bytes:
        """Write a pull, which asks for what this replica lacks. `alive`: the digest of its alive
        set.
        """
        facts = self.facts.map
        digests = facts.author_digests()
        parted = [author for author in digests if facts.count_of(author) >= PARTED_FROM]
        parts = {author: facts.part_digests(author) for author in parted}
        return encode(self.header, MessageKind.PULL, [digests, alive, parts])

    def answer_pull(
        self, data: bytes, view: Callable[[bytes], Mapping[str, SelfReport]] | None = None
    ) -> tuple[bytes, ...]:
        """RequestAnswer a pull: all entries of every author whose digest differs. If the asker sent
        digests of the author's parts, only those of differing parts.

        The answer comes in pages far below the size limit of a message; a batch is never split.
        `view` maps the digest of the asker's alive set to the robots that are alive here, if these
        differ; it is sent with the last page. Raises WireError.
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
        """Return the parts of an author's entries to send, or None for all."""
        if theirs is None:
            return None
        mine = self.facts.map.part_digests(author)
        # Part digests may collide; the author's digest, which is longer, does not.
        at = range(0, len(mine), 8)
        return frozenset(n // 8 for n in at if mine[n : n + 8] != theirs[n : n + 8]) or None


class Durability:
    """What this robot's journal is known to hold: promises are made only from what is on disk.

    Numbers the writes that must be on disk, and knows up to which number all of them are.
    `problem`: what is wrong with the journal, for people; empty if nothing is. `is_failing`: it
    cannot be written now. `keeps_journal`: there is a journal, so syncing is worth waiting for.
    """

    def __init__(
        self, problem: str = "", is_failing: bool = False, keeps_journal: bool = True
    ) -> None:
        self.problem = problem
        self.is_failing = is_failing
        self.keeps_journal = keeps_journal
        self._last = 0
        self._synced = 0
        # Nothing counts as on disk before this number is.
        self._whole_from = 0

    @property
    def may_promise(self) -> bool:
        """True if new writes, and all earlier ones, will be on disk soon."""
        return not self.is_failing and self._synced >= self._whole_from

    def take_number(self) -> int:
        """Return the number of the next write."""
        self._last += 1
        return self._last

    def begin_anew(self) -> int:
        """Start over, as the journal may have lost anything. Returns the full rewrite's number."""
        self._whole_from = self.take_number()
        return self._whole_from

    def note_synced(self, number: int) -> None:
        """Note that everything up to this number is on disk."""
        self._synced = max(self._synced, number)

    def is_on_disk(self, number: int) -> bool:
        """True if this write and all earlier ones are on disk."""
        return self._synced >= max(number, self._whole_from)
