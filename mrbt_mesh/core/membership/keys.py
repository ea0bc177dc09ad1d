"""The members of a team by name, what each may send, and how it is proved that one sent it.

The core only asks; keys themselves, and the mathematics, are in the runtime.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeAlias

import msgpack

from mrbt_mesh.core.facts.records import OPERATORS, OperatorCommand
from mrbt_mesh.core.facts.store import BatchProof, Entry, Version, parse_entry

TAG_BYTES = 16
SIGNATURE_BYTES = 64


class Role(enum.StrEnum):
    """What a member may do: robots take part, operators read and command, observers read.

    Routers pass on messages of others, and send none themselves.
    """

    ROBOT = "robot"
    OPERATOR = "operator"
    OBSERVER = "observer"
    ROUTER = "router"


class Keys(Protocol):
    """One member's private key, and the public ones of its team as it knows them now."""

    @property
    def name(self) -> str:
        """Whose private key this is."""

    def members(self) -> Sequence[str]:
        """All members in good standing that messages are for, sorted: routers are not."""

    def role_of(self, name: str) -> Role | None:
        """None for strangers, for routers and for members whose key has been revoked."""

    def sign(self, data: bytes) -> bytes:
        """`SIGNATURE_BYTES` that anybody with the manifest can check."""

    def is_signed(self, name: str, data: bytes, signature: bytes) -> bool:
        """Whether a member in good standing signed this, with its present key."""

    def was_signed(self, name: str, data: bytes, signature: bytes, role: Role = Role.ROBOT) -> bool:
        """Whether a member with this role signed this, also if it has been revoked since, or its
        key replaced.
        """

    def tag(self, name: str, data: bytes) -> bytes | None:
        """`TAG_BYTES` that only this member and the one named can make; None for a stranger."""


HASH_BYTES = 16
# Proofs that were found good lately: entries of one batch come together, and some come again.
RECENT = 1_024
NOT_AUTHENTIC = "not signed by its author, or not by the operator who commands it"


# Whether a member, by its name and role, signed data: as `Keys.was_signed`.
WasSigned: TypeAlias = Callable[[str, bytes, bytes, Role], bool]


def command_content(run: str, name: str, version: Version, values: Sequence[Any]) -> bytes:
    """What an operator signs: a command's field and subject, when it was given, and its values:
    what is commanded, and by whom.
    """
    (stamp, command_id), _ = version
    return bytes(msgpack.packb(["mrbt command", run, name, stamp, command_id, list(values)]))


def make_command(
    name: str, value: Any, operator: str, version: Version, run: str, keys: Keys | None
) -> Entry:
    """A command, signed by its operator in a team with keys. Raises ValueError if it is malformed.

    `value`: as plain data. `version`: the stamp and the id that the operator's client gives.
    """
    entry = parse_entry(OPERATORS, name, version, [value, operator, "", ""])
    if keys is None:
        return entry
    # What is signed is what was read: robots read no more of it, and its numbers can be packed.
    assert isinstance(entry.record, OperatorCommand)
    values = entry.record.to_value()[:2]
    content = command_content(run, entry.name, version, values)
    values += [keys.name, keys.sign(content).hex()]
    return parse_entry(OPERATORS, entry.name, version, values)


class Authorship:
    """Batches of facts signed by their author, so that robots that pass them on cannot change them.

    The signature is over the hashes of all entries of a batch. Newer entries replace single ones of
    an older batch; the others keep its proof, and it is passed on with them. Commands are signed
    by their operator alone, each by itself, so that no robot can make one.
    """

    def __init__(self, was_signed: WasSigned, run: str) -> None:
        self._was_signed = was_signed
        self._run = run
        self._good: set[tuple[str, Version, bytes, bytes]] = set()

    def is_authentic(self, entry: Entry) -> bool:
        """Whether the author of an entry has signed it; a command, an operator."""
        proof = entry.proof
        if entry.author == OPERATORS:
            return self.is_by_operator(entry)
        if proof is None or not _holds(proof.hashes, _hash(entry)):
            return False
        key = (entry.author, entry.version, proof.hashes, proof.signature)
        if key in self._good:
            return True
        content = self._content(entry, proof.hashes)
        if not self._was_signed(entry.author, content, proof.signature, Role.ROBOT):
            return False
        if len(self._good) >= RECENT:
            self._good.clear()
        self._good.add(key)
        return True

    def is_by_operator(self, entry: Entry) -> bool:
        """Whether an operator has signed a command."""
        command = entry.record
        if not isinstance(command, OperatorCommand):
            return False
        try:
            signature = bytes.fromhex(command.signature)
        except ValueError:
            return False
        values = command.to_value()[:2]
        content = command_content(self._run, entry.name, entry.version, values)
        return self._was_signed(command.signer, content, signature, Role.OPERATOR)

    def sign(
        self, proof: BatchProof, entries: Sequence[Entry], sign: Callable[[bytes], bytes]
    ) -> None:
        """Complete the proof that the entries of a new batch have in common, at least one."""
        proof.hashes = b"".join([_hash(entry) for entry in entries])
        proof.signature = sign(self._content(entries[0], proof.hashes))

    def _content(self, entry: Entry, hashes: bytes) -> bytes:
        (counter, nonce), sequence = entry.version
        head = ["mrbt batch", self._run, entry.author, counter, nonce, sequence]
        return bytes(msgpack.packb(head)) + hashes


def _hash(entry: Entry) -> bytes:
    return entry.hash.to_bytes(HASH_BYTES, "big")


def _holds(hashes: bytes, wanted: bytes) -> bool:
    steps = range(0, len(hashes), HASH_BYTES)
    return any(hashes[at : at + HASH_BYTES] == wanted for at in steps)
