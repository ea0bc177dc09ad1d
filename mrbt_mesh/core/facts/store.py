"""The map of facts: single-writer entries that join as a state-based CRDT.

Joining is commutative, associative and idempotent, so loss, duplication and reordering of messages
only delay agreement (Shapiro, Preguica, Baquero, Zawirski: Conflict-free replicated data types,
2011). This module knows keys, versions, joining and digests. `records` defines what the entries
mean, `team_facts` how the team reads them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import msgpack

from mrbt_mesh.core.facts.records import Record, parse_record, split_name

MAX_VALUE_BYTES = 1 << 18
# What a robot writes: the name and the record of an entry.
Fact: TypeAlias = tuple[str, Record]
_DIGEST_MODULUS = 1 << 128


class Incarnation(NamedTuple):
    """One life of a robot's process: a counter above all those known, and a nonce of the process.

    Counter 0 is a newcomer that has not joined yet.
    """

    counter: int
    nonce: str

    def __str__(self) -> str:
        return f"{self.counter}.{self.nonce}"


class Version(NamedTuple):
    """Orders the entries of one author. All entries of one batch share it."""

    incarnation: Incarnation
    sequence: int


@dataclass(slots=True)
class BatchProof:
    """Proves that an author wrote a batch: the hashes of its entries, and a signature over them."""

    hashes: bytes = b""
    signature: bytes = b""


# Decode an entry's bytes to its value.
plain_value = partial(msgpack.unpackb, strict_map_key=False)


@dataclass(frozen=True, slots=True)
class Entry:
    """One fact. `packed`: its value as on the wire; `record`: the value parsed.

    `parts`: the parts of its name, the kind first. `hash`: 128 bits over author, name, version and
    value. `proof`: the proof of its batch, in a team with keys; it is not part of the fact.
    """

    author: str
    name: str
    parts: tuple[str, ...]
    version: Version
    record: Record
    packed: bytes
    hash: int
    proof: BatchProof | None = field(default=None, compare=False, repr=False)

    @property
    def value(self) -> Any:
        """The value as plain data."""
        return plain_value(self.packed)


def parse_entry(
    author: str, name: str, version: Version, value: Any, proof: BatchProof | None = None
) -> Entry:
    """Make an entry from the wire or the disk. Raises ValueError if its kind has no such value."""
    return make_entry(author, name, version, parse_record(name, value)[1], proof, value)


def make_entry(
    author: str,
    name: str,
    version: Version,
    record: Record,
    proof: BatchProof | None = None,
    value: Any = None,
) -> Entry:
    """Make an entry. Raises ValueError if it is too large. `value`: as received, None for own."""
    value = record.to_value() if value is None else value
    try:
        packed = msgpack.packb(value)
    except (TypeError, OverflowError) as error:
        raise ValueError(f"not plain data: {error}") from error
    if len(packed) > MAX_VALUE_BYTES:
        raise ValueError(f"value of {len(packed)} bytes, at most {MAX_VALUE_BYTES} are taken")
    (counter, nonce), sequence = version
    head = msgpack.packb([author, name, counter, nonce, sequence])
    digest = hashlib.blake2b(head + packed, digest_size=16).digest()
    number = int.from_bytes(digest, "big")
    parts = split_name(name)
    return Entry(author, name, parts, version, record, packed, number, proof)


def join(mine: Entry | None, other: Entry) -> Entry:
    """Return which of two entries with the same key is kept, regardless of their order.

    The greater version wins, equal versions (which should not occur) are decided by their bytes. Of
    `write_once` records the older one wins. Records that grow by other rules (a success beats a
    failure) have a `Record.rank`, which goes first.
    """
    if mine is None:
        return other
    mine_rank, other_rank = mine.record.rank(), other.record.rank()
    if mine_rank != other_rank:
        return other if other_rank > mine_rank else mine
    mine_key, other_key = (mine.version, mine.packed), (other.version, other.packed)
    newest = other if other_key > mine_key else mine
    oldest = mine if newest is other else other
    return oldest if mine.record.write_once else newest


# An entry before and after a change; None if it was or is absent.
Change: TypeAlias = tuple[Entry | None, Entry | None]
Listener: TypeAlias = Callable[[Sequence[Change]], None]


# The entries of each author are divided into this many parts. A pull has a digest of each part, so
# the answer need only carry the entries of parts that differ.
PARTS = 64
_PART_MODULUS = 1 << 64


def part_of(version: Version) -> int:
    """The part that a batch, and all of its entries, belongs to."""
    return (version.incarnation.counter + version.sequence) % PARTS


class FactMap:
    """All entries, with a digest per author that is updated entry by entry."""

    def __init__(self) -> None:
        self._by_author: dict[str, dict[str, Entry]] = {}
        self._digests: dict[str, int] = {}
        self._total = 0
        self._digest: bytes | None = None
        self._listeners: list[Listener] = []

    def __len__(self) -> int:
        return sum(map(len, self._by_author.values()))

    def __iter__(self) -> Iterator[Entry]:
        """Entries sorted by author and name."""
        return (entry for author in sorted(self._by_author) for entry in self.of_author(author))

    def subscribe(self, listener: Listener) -> None:
        """Have `listener` called after each batch, with all changes that it made."""
        self._listeners.append(listener)

    def get(self, author: str, name: str) -> Entry | None:
        """The author's entry with this name, None if there is none."""
        entries = self._by_author.get(author)
        return entries.get(name) if entries is not None else None

    def merge(self, entries: Iterable[Entry]) -> list[Entry]:
        """Join entries into the map. Returns those that changed it."""
        changes: list[tuple[Entry | None, Entry]] = []
        for entry in entries:
            own = self._by_author.setdefault(entry.author, {})
            old = own.get(entry.name)
            new = join(old, entry)
            if old is not None and (new.version, new.packed) == (old.version, old.packed):
                continue
            own[entry.name] = new
            self._add_to_digest(new.author, new.hash - (old.hash if old else 0))
            changes.append((old, new))
        if changes:
            self._notify(changes)
        return [new for _, new in changes]

    def drop(self, author: str, name: str) -> None:
        """Drop an entry that no evaluation can reach any more."""
        own = self._by_author.get(author, {})
        entry = own.pop(name, None)
        if entry is not None:
            if not own:
                del self._by_author[author]
            self._add_to_digest(author, -entry.hash)
            self._notify([(entry, None)])

    def _notify(self, changes: Sequence[Change]) -> None:
        for listener in self._listeners:
            listener(changes)

    def _add_to_digest(self, author: str, change: int) -> None:
        self._digest = None
        self._total = (self._total + change) % _DIGEST_MODULUS
        total = (self._digests.get(author, 0) + change) % _DIGEST_MODULUS
        if total:
            self._digests[author] = total
        else:
            self._digests.pop(author, None)

    def authors(self) -> Iterable[str]:
        """The authors of all entries, in an order that may differ between replicas."""
        return self._by_author.keys()

    def author_digests(self) -> dict[str, bytes]:
        """A 16-byte digest of each author's entries, sorted by author: a version summary."""
        return {a: self._digests[a].to_bytes(16, "big") for a in sorted(self._digests)}

    def part_digests(self, author: str) -> bytes:
        """`PARTS` digests of 8 bytes, one for each part of the author's entries; see `part_of`."""
        totals = [0] * PARTS
        for entry in self._by_author.get(author, {}).values():
            totals[part_of(entry.version)] += entry.hash
        return b"".join([(total % _PART_MODULUS).to_bytes(8, "big") for total in totals])

    def count_of(self, author: str) -> int:
        """The number of an author's entries."""
        return len(self._by_author.get(author, {}))

    def digest(self) -> bytes:
        """An 8-byte digest of the whole map, computed from the sum of all entries' hashes."""
        if self._digest is None:
            total = self._total.to_bytes(16, "big")
            self._digest = hashlib.blake2b(total, digest_size=8).digest()
        return self._digest

    def of_author(self, author: str) -> list[Entry]:
        """The author's entries, sorted by name."""
        entries = self._by_author.get(author, {})
        return [entries[name] for name in sorted(entries)]
