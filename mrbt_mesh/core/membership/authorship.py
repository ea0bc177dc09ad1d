"""Batches of facts signed by their author, so that whoever passes them on cannot change them.

The signature is over the hashes of all entries of a batch. Newer entries replace single ones of an
older batch; those that still stand keep its proof, and it is passed on with them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import msgpack

from mrbt_mesh.core.facts.store import BatchProof, Entry, Version
from mrbt_mesh.core.membership.keys import Keys

HASH_BYTES = 16
# Proofs that were found good lately: entries of one batch come together, and some come again.
RECENT = 1_024
NOT_AUTHENTIC = "not signed by its author"


# Whether a member, by its name, signed data: as `Keys.was_signed`.
WasSigned: TypeAlias = Callable[[str, bytes, bytes], bool]


class AuthorshipCheck:
    """Checks the batches of all authors of one run."""

    def __init__(self, was_signed: WasSigned, run: str) -> None:
        self._was_signed = was_signed
        self._run = run
        self._good: set[tuple[str, Version, bytes, bytes]] = set()

    def is_authentic(self, entry: Entry) -> bool:
        """Whether the author of an entry has signed it."""
        proof = entry.proof
        if proof is None or not _holds(proof.hashes, _hash(entry)):
            return False
        key = (entry.author, entry.version, proof.hashes, proof.signature)
        if key in self._good:
            return True
        content = self._content(entry, proof.hashes)
        if not self._was_signed(entry.author, content, proof.signature):
            return False
        if len(self._good) >= RECENT:
            self._good.clear()
        self._good.add(key)
        return True

    def _content(self, entry: Entry, hashes: bytes) -> bytes:
        (counter, nonce), sequence = entry.version
        head = ["mrbt batch", self._run, entry.author, counter, nonce, sequence]
        return bytes(msgpack.packb(head)) + hashes


class Authorship(AuthorshipCheck):
    """Signs the batches of one robot as well."""

    def __init__(self, keys: Keys, run: str) -> None:
        super().__init__(keys.was_signed, run)
        self._keys = keys

    def sign(self, proof: BatchProof, entries: Sequence[Entry]) -> None:
        """Complete the proof that the entries of a new batch have in common, at least one."""
        first = entries[0]
        proof.hashes = b"".join([_hash(entry) for entry in entries])
        proof.signature = self._keys.sign(self._content(first, proof.hashes))


def _hash(entry: Entry) -> bytes:
    return entry.hash.to_bytes(HASH_BYTES, "big")


def _holds(hashes: bytes, wanted: bytes) -> bool:
    steps = range(0, len(hashes), HASH_BYTES)
    return any(hashes[at : at + HASH_BYTES] == wanted for at in steps)
