"""The members of a team by name, what each may send, and how a sender is authenticated.

The core only uses the interface; the keys and the cryptography are in the runtime.
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

    Routers forward messages of others and send none themselves.
    """

    ROBOT = "robot"
    OPERATOR = "operator"
    OBSERVER = "observer"
    ROUTER = "router"


class Keys(Protocol):
    """One member's private key, and the public keys of its team as known now."""

    @property
    def name(self) -> str:
        """The member that the private key belongs to."""

    def members(self) -> Sequence[str]:
        """All members in good standing that may receive messages, sorted. Routers do not."""

    def role_of(self, name: str) -> Role | None:
        """Return None for strangers, routers and members whose key has been revoked."""

    def sign(self, data: bytes) -> bytes:
        """Return a signature of `SIGNATURE_BYTES` that anybody with the manifest can check."""

    def is_signed(self, name: str, data: bytes, signature: bytes) -> bool:
        """True if a member in good standing signed the data with its present key."""

    def was_signed(self, name: str, data: bytes, signature: bytes, role: Role = Role.ROBOT) -> bool:
        """True if a member with this role signed the data, even if its key has been revoked or
        replaced since.
        """

    def tag(self, name: str, data: bytes) -> bytes | None:
        """Return `TAG_BYTES` that only this member and `name` can compute; None for a stranger."""


HASH_BYTES = 16
# Valid proofs are cached: entries of one batch arrive together, and some arrive again.
RECENT = 1_024
NOT_AUTHENTIC = "not signed by its author, or not by the operator who commands it"


# True if a member, by name and role, signed data: as `Keys.was_signed`.
WasSigned: TypeAlias = Callable[[str, bytes, bytes, Role], bool]


def command_content(run: str, name: str, version: Version, values: Sequence[Any]) -> bytes:
    """Return what an operator signs: a command's field and subject, when it was given, and its
    values, which are what is commanded and by whom.
    """
    (stamp, command_id), _ = version
    return bytes(msgpack.packb(["mrbt command", run, name, stamp, command_id, list(values)]))


def make_command(
    name: str, value: Any, operator: str, version: Version, run: str, keys: Keys | None
) -> Entry:
    """Make a command, signed by its operator in a team with keys. Raises ValueError if it is
    malformed.

    `value`: plain data. `version`: the stamp and the id given by the operator's client.
    """
    entry = parse_entry(OPERATORS, name, version, [value, operator, "", ""])
    if keys is None:
        return entry
    # Sign what was parsed: robots read no more than that, and its numbers can be packed.
    assert isinstance(entry.record, OperatorCommand)
    values = entry.record.to_value()[:2]
    content = command_content(run, entry.name, version, values)
    values += [keys.name, keys.sign(content).hex()]
    return parse_entry(OPERATORS, entry.name, version, values)


class Authorship:
    """Batches of facts are signed by their author, so robots that relay them cannot change them.

    The signature covers the hashes of all entries of a batch. Newer entries replace single entries
    of an older batch; the rest keep its proof, which is passed on with them. Commands are signed
    only by their operator, each by itself, so no robot can make one.
    """

    def __init__(self, was_signed: WasSigned, run: str) -> None:
        self._was_signed = was_signed
        self._run = run
        self._good: set[tuple[str, Version, bytes, bytes]] = set()

    def is_authentic(self, entry: Entry) -> bool:
        """True if an entry is signed by its author, or a command by an operator."""
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
        """True if an operator has signed this command."""
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
        """Complete the proof shared by the entries of a new batch. `entries` must not be empty."""
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
