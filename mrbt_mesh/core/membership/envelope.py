"""The envelope around every message of a team with keys: its sender, and the proof of that.

A message to few members carries a tag for each, made with a key that only the two of them share;
one to many carries a signature. Tags cost a hundredth of a signature, which is what makes it
possible to prove every heartbeat (Castro and Liskov, Practical Byzantine fault tolerance, 1999,
do the same). Replays are refused by run, by the sender's life (one process from its start to its
end), and by the number that it gives each message.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import msgpack

from mrbt_mesh.core.membership.keys import SIGNATURE_BYTES, Keys, Role
from mrbt_mesh.core.membership.wire import (
    MAX_MESSAGE_BYTES,
    SEALED,
    IncompatibleError,
    MessageKind,
    WireError,
)

# To more receivers a signature is cheaper than tags: it takes each of them a hundred times as long
# to check, but adds no more bytes. Operators and observers are receivers too.
MAX_TAGS = 128
# How far messages of one life may overtake one another.
WINDOW = 256
# Lives of each sender that are remembered; a sender whose clock goes backwards at every start may
# have no more in one run.
MAX_LIVES = 32
_MAX_NAME = 64
# More than `MAX_TAGS` tags with names as long as they may be.
_MAX_PROOF_BYTES = 16 << 10
# How every envelope begins: a list of eight, and the first of them.
_START = b"\x98" + msgpack.packb(SEALED)

_MAY_SAY = {
    Role.ROBOT: frozenset(
        (
            MessageKind.HEARTBEAT,
            MessageKind.FACT,
            MessageKind.PULL,
            MessageKind.STATE,
            MessageKind.ANSWER,
        )
    ),
    Role.OPERATOR: frozenset((MessageKind.PULL, MessageKind.COMMAND)),
    Role.OBSERVER: frozenset((MessageKind.PULL,)),
}


class ForgedError(WireError):
    """A message that is not proved to come from a member with the right to send it."""


class Envelope(NamedTuple):
    """A message with its proof, as yet unchecked.

    `life`: when the sender's process began, in us on a clock of its own; `number` counts its
    messages. `to`: the one receiver, empty for several. `proof`: a tag by receiver, or a signature.
    """

    run: str
    sender: str
    life: int
    number: int
    to: str
    data: bytes
    proof: dict[str, bytes] | bytes

    @property
    def content(self) -> bytes:
        """A digest of all that the proof is for."""
        head = msgpack.packb([SEALED, self.run, self.sender, self.life, self.number, self.to])
        digest = hashlib.blake2b(head, digest_size=32)
        digest.update(self.data)
        return digest.digest()


def has_tag(keys: Keys, envelope: Envelope, life: int | None = None) -> bool:
    """Whether the sender has put a tag for this member on it; `life`: a command's, for this one."""
    tag = envelope.proof.get(keys.name) if isinstance(envelope.proof, dict) else None
    if not isinstance(tag, bytes):
        return False
    content = envelope.content if life is None else _bound(envelope.content, life)
    expected = keys.tag(envelope.sender, content)
    return expected is not None and hmac.compare_digest(tag, expected)


def parse_envelope(data: bytes) -> Envelope:
    """Take an envelope apart; raises ForgedError for anything else, nothing else."""
    if len(data) > MAX_MESSAGE_BYTES:
        raise ForgedError(f"more than {MAX_MESSAGE_BYTES} bytes")
    if not data.startswith(_START):
        raise ForgedError("not signed")
    # Nothing that could become much larger than it is here: no lists, and only a short map.
    unpacker = msgpack.Unpacker(
        max_buffer_size=MAX_MESSAGE_BYTES,
        max_str_len=_MAX_NAME,
        max_bin_len=MAX_MESSAGE_BYTES,
        max_array_len=0,
        max_map_len=0,
        max_ext_len=0,
    )
    unpacker.feed(memoryview(data)[len(_START) :])
    try:
        run, sender, life, number, to, inner = [unpacker.unpack() for _ in range(6)]
        rest = data[len(_START) + unpacker.tell() :][: _MAX_PROOF_BYTES + 1]
        proof = msgpack.unpackb(rest, max_array_len=0, max_map_len=2 * MAX_TAGS, max_ext_len=0)
    except (ValueError, TypeError, msgpack.UnpackException, RecursionError):
        raise ForgedError("not signed") from None
    are_texts = isinstance(run, str) and isinstance(sender, str) and isinstance(to, str)
    are_counts = type(life) is int and type(number) is int and life >= 0 and number > 0
    if not are_texts or not are_counts or not isinstance(inner, bytes):
        raise ForgedError("envelope is malformed")
    if not isinstance(proof, bytes | dict):
        raise ForgedError("envelope is malformed")
    return Envelope(run, sender, life, number, to, inner, proof)


@dataclass(slots=True)
class _Life:
    """What has been received of one life: the highest number, and which of those before it."""

    highest: int = 0
    seen: int = 0

    def take(self, number: int) -> bool:
        """Whether this number is new, or too old to tell."""
        ahead = number - self.highest
        if ahead > 0:
            self.seen = ((self.seen << ahead) | 1) & ((1 << WINDOW) - 1) if ahead < WINDOW else 1
            self.highest = number
            return True
        if -ahead >= WINDOW or self.seen >> -ahead & 1:
            return False
        self.seen |= 1 << -ahead
        return True


class HeardMessages:
    """What has been heard of each sender, so that nothing counts twice."""

    def __init__(self) -> None:
        self._lives: dict[str, dict[int, _Life]] = {}

    def latest_life(self, sender: str) -> int:
        """The latest life from which there was news; 0: none."""
        return max(self._lives.get(sender, ()), default=0)

    def is_news(self, envelope: Envelope) -> bool:
        """Whether this was not heard before; from now on it was. Its proof must be good."""
        lives = self._lives.setdefault(envelope.sender, {})
        life = lives.get(envelope.life)
        if life is None:
            if len(lives) >= MAX_LIVES:
                oldest = min(lives)
                if envelope.life < oldest:
                    return False
                del lives[oldest]
            life = lives[envelope.life] = _Life()
        return life.take(envelope.number)


class Guard:
    """Seals what one member sends and opens what it receives.

    `life`: when its process began, greater than that of its earlier processes.
    """

    def __init__(self, keys: Keys, run: str, life: int) -> None:
        self.keys = keys
        self._run = run
        self._life = life
        self._number = 0
        self._memory = HeardMessages()

    # -- sending ------------------------------------------------------------------------------

    def seal(self, data: bytes, to: Iterable[str] | None = None) -> bytes:
        """A message to some members; None: to all of them."""
        names = self.keys.members() if to is None else sorted(to)
        one = names[0] if to is not None and len(names) == 1 else ""
        head = self._head(one, data)
        proof: dict[str, bytes] | bytes
        if len(names) > MAX_TAGS:
            proof = self.keys.sign(head.content)
        else:
            tags = [(name, self.keys.tag(name, head.content)) for name in names]
            proof = {name: tag for name, tag in tags if tag is not None}
        return bytes(msgpack.packb([SEALED, *head[:-1], proof]))

    def seal_command(self, data: bytes, to: str) -> bytes:
        """A command to one robot, in the life from which there was news last.

        The process that follows does not obey it again.
        """
        head = self._head(to, data)
        tag = self.keys.tag(to, _bound(head.content, self._memory.latest_life(to)))
        return bytes(msgpack.packb([SEALED, *head[:-1], {to: tag} if tag is not None else {}]))

    def _head(self, to: str, data: bytes) -> Envelope:
        self._number += 1
        return Envelope(self._run, self.keys.name, self._life, self._number, to, data, b"")

    # -- receiving ----------------------------------------------------------------------------

    def open(
        self,
        data: bytes,
        kind: MessageKind,
        source: str | None = None,
        checked: Envelope | None = None,
    ) -> tuple[str, bytes]:
        """(sender, message) of an envelope; `source`: the member that must have sent it; `checked`:
        the same envelope, if this member's tag on it has been checked already.

        Raises ForgedError for whatever is not authentic, for a replay, and for what the sender may
        not say; IncompatibleError for an authentic message of another run.
        """
        envelope = parse_envelope(data) if checked is None else checked
        sender, role = envelope.sender, self.keys.role_of(envelope.sender)
        if role is None:
            raise ForgedError(f"{sender[:32]!r} has no key in this team")
        if source is not None and source != sender:
            raise ForgedError(f"sent by {sender} under the name of {source}")
        if kind not in _MAY_SAY[role]:
            raise ForgedError(f"{sender} is known as {role} and may not say this")
        if envelope.to not in ("", self.keys.name):
            raise ForgedError("meant for somebody else")
        if checked is None:
            self._check_proof(envelope, kind)
        if envelope.run != self._run:
            raise IncompatibleError(f"run {envelope.run!r} (ours is {self._run!r})")
        if not self._memory.is_news(envelope):
            raise ForgedError("said before")
        return sender, envelope.data

    def _check_proof(self, envelope: Envelope, kind: MessageKind) -> None:
        content, proof, is_good = envelope.content, envelope.proof, False
        if isinstance(proof, bytes):
            # Commands are for one process, and carry its tag.
            if len(proof) == SIGNATURE_BYTES and kind is not MessageKind.COMMAND:
                is_good = self.keys.is_signed(envelope.sender, content, proof)
        else:
            tag = proof.get(self.keys.name)
            if not isinstance(tag, bytes):
                raise ForgedError("not meant for this member")
            if kind is MessageKind.COMMAND:
                content = _bound(content, self._life)
            expected = self.keys.tag(envelope.sender, content)
            is_good = expected is not None and hmac.compare_digest(tag, expected)
        if not is_good:
            raise ForgedError("signature is wrong")


def _bound(content: bytes, life: int) -> bytes:
    """What the tag of a command is for, which only this life of the receiver obeys."""
    return content + life.to_bytes(8, "big")
