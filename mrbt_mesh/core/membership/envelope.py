"""The envelope around every message in a team with keys: its sender, and the proof of that.

A message to few members carries a tag for each, computed with a key that only the sender and that
member share; a message to many carries a signature. Tags cost a hundredth of a signature, which
makes it possible to authenticate every heartbeat (Castro and Liskov, Practical Byzantine fault
tolerance, 1999, do the same). Replays are refused by run, by the sender's life (one process from
its start to its end), and by the number that the sender gives each message.

All programs of one operator share its key, so one sender may have many lives at a time. A receiver
remembers a bounded number of them and forgets the one that was silent for longest. It refuses
everything of a forgotten life, and of any life not known to be later, since it cannot tell what it
has already heard of it. It answers queries of such a life with the latest forgotten life, and the
sender continues in a later one.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple, NoReturn

import msgpack

from mrbt_mesh.core.membership.keys import SIGNATURE_BYTES, Keys, Role
from mrbt_mesh.core.membership.wire import (
    MAX_MESSAGE_BYTES,
    SEALED,
    IncompatibleError,
    MessageKind,
    WireError,
)
from mrbt_mesh.core.mission.failure_reasons import one_line

# For more receivers a signature is cheaper than tags: checking it takes each receiver a hundred
# times as long, but its size is fixed. Operators and observers are receivers too.
MAX_TAGS = 128
# How many numbers a message may arrive late within one life.
WINDOW = 256
# The number of lives remembered per sender.
MAX_LIVES = 256
# Lives are microseconds of some clock, which never come near this.
MAX_LIFE = 1 << 62
# The most by which a forgotten sender's new life is later, chosen so that no two are equal.
_SPREAD = 1 << 20
_MAX_NAME = 64
# More than the size of `MAX_TAGS` tags with names of the maximum length.
_MAX_PROOF_BYTES = 16 << 10
# The first bytes of every envelope: a list of nine items, and the first item.
_START = b"\x99" + msgpack.packb(SEALED)
# The first bytes of the answer to an authentic query that is refused.
_REFUSAL = b"\x93" + msgpack.packb("refused")

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


_ANSWERS = frozenset((MessageKind.STATE, MessageKind.ANSWER))


class ForgedError(WireError):
    """A replay, or a message not proved to come from a member with the right to send it."""


class LateError(WireError):
    """An authentic message overtaken by so many later ones that it may be a replay."""


class StaleError(WireError):
    """An authentic message of a forgotten life, or for an earlier life of its receiver.

    `sender` may be answered with `content`, which raises `RefusedError` there.
    """

    def __init__(self, sender: str, reason: str, forgotten: int = 0) -> None:
        super().__init__(reason)
        self.sender = sender
        self.content = bytes(msgpack.packb(["refused", reason, forgotten]))


class RefusedError(WireError):
    """The answer to a query that its receiver refused. The same query may be sent again."""


class Envelope(NamedTuple):
    """A message with its proof, not yet checked.

    `life`: when the sender's process began, in us on a clock of its own; `number` counts its
    messages. `to`: the one receiver, empty for several; `to_life`: the receiver's life, for a
    command. `proof`: tags by receiver, or a signature.
    """

    run: str
    sender: str
    life: int
    number: int
    to: str
    to_life: int
    data: bytes
    proof: dict[str, bytes] | bytes

    @property
    def content(self) -> bytes:
        """A digest of everything that the proof covers."""
        head = msgpack.packb([SEALED, *self[:-2]])
        digest = hashlib.blake2b(head, digest_size=32)
        digest.update(self.data)
        return digest.digest()


def has_tag(keys: Keys, envelope: Envelope) -> bool:
    """True if the envelope carries the sender's valid tag for this member."""
    tag = envelope.proof.get(keys.name) if isinstance(envelope.proof, dict) else None
    if not isinstance(tag, bytes):
        return False
    expected = keys.tag(envelope.sender, envelope.content)
    return expected is not None and hmac.compare_digest(tag, expected)


def parse_envelope(data: bytes) -> Envelope:
    """Parse an envelope. Raises only ForgedError, whatever the data is."""
    if len(data) > MAX_MESSAGE_BYTES:
        raise ForgedError(f"more than {MAX_MESSAGE_BYTES} bytes")
    if not data.startswith(_START):
        raise ForgedError("not signed")
    # Forbid anything that could become much larger in memory: no lists, and only a short map.
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
        run, sender, life, number, to, to_life, inner = [unpacker.unpack() for _ in range(7)]
        rest = data[len(_START) + unpacker.tell() :][: _MAX_PROOF_BYTES + 1]
        proof = msgpack.unpackb(rest, max_array_len=0, max_map_len=2 * MAX_TAGS, max_ext_len=0)
    except (ValueError, TypeError, msgpack.UnpackException, RecursionError):
        raise ForgedError("not signed") from None
    are_texts = isinstance(run, str) and isinstance(sender, str) and isinstance(to, str)
    are_lives = all(type(each) is int and 0 <= each <= MAX_LIFE for each in (life, to_life))
    if not are_texts or not are_lives or not isinstance(inner, bytes):
        raise ForgedError("envelope is malformed")
    if type(number) is not int or number <= 0 or not isinstance(proof, bytes | dict):
        raise ForgedError("envelope is malformed")
    return Envelope(run, sender, life, number, to, to_life, inner, proof)


@dataclass(slots=True)
class _Life:
    """What was received of one life: the highest number, and a bitmap of those just before it."""

    highest: int = 0
    seen: int = 0

    def take(self, number: int) -> None:
        """Record a number. Raises LateError if it is too old to tell, ForgedError if repeated."""
        ahead = number - self.highest
        if ahead > 0:
            self.seen = ((self.seen << ahead) | 1) & ((1 << WINDOW) - 1) if ahead < WINDOW else 1
            self.highest = number
        elif -ahead >= WINDOW:
            raise LateError(f"late: {WINDOW} messages of its sender overtook it")
        elif self.seen >> -ahead & 1:
            raise ForgedError("said before")
        else:
            self.seen |= 1 << -ahead


@dataclass(slots=True)
class _Sender:
    """The lives of one sender, in order: the one that was silent for longest first.

    `forgotten`: the latest life that is no longer remembered. A later one that is not in `lives`
    was never heard.
    """

    lives: dict[int, _Life] = field(default_factory=dict)
    forgotten: int = 0


class HeardMessages:
    """What has been heard of each sender, so that nothing counts twice."""

    def __init__(self) -> None:
        self._senders: dict[str, _Sender] = {}

    def latest_life(self, sender: str) -> int:
        """The life of which news came last; 0 if there is none."""
        known = self._senders.get(sender)
        return next(reversed(known.lives)) if known is not None else 0

    def take(self, envelope: Envelope) -> None:
        """Record an authentic message.

        Raises ForgedError if it was heard before, LateError or StaleError if it may have been.
        """
        name, life = envelope.sender, envelope.life
        known = self._senders.get(name)
        if known is None:
            known = self._senders[name] = _Sender()
        if life not in known.lives and life <= known.forgotten:
            reason = f"a life of {name} from before {MAX_LIVES} others: it has to take a later one"
            raise StaleError(name, reason, known.forgotten)
        heard = known.lives.get(life) or _Life()
        heard.take(envelope.number)
        known.lives.pop(life, None)
        known.lives[life] = heard
        if len(known.lives) > MAX_LIVES:
            silent = next(iter(known.lives))
            del known.lives[silent]
            known.forgotten = max(known.forgotten, silent)


class Guard:
    """Seals what one member sends and opens what it receives.

    `life`: when its process began, later than every earlier process of it.
    """

    def __init__(self, keys: Keys, run: str, life: int) -> None:
        self.keys = keys
        self._run = run
        self._life = life
        # Receiver -> the life used with receivers that have forgotten the original one.
        self._later_lives: dict[str, int] = {}
        self._number = 0
        self._memory = HeardMessages()

    # -- sending ------------------------------------------------------------------------------

    def seal(self, data: bytes, to: Iterable[str] | None = None) -> bytes:
        """Seal a message to some members; None: to all of them."""
        names = self.keys.members() if to is None else sorted(to)
        one = names[0] if to is not None and len(names) == 1 else ""
        head = self._head(one, 0, data)
        proof: dict[str, bytes] | bytes
        if len(names) > MAX_TAGS:
            proof = self.keys.sign(head.content)
        else:
            tags = [(name, self.keys.tag(name, head.content)) for name in names]
            proof = {name: tag for name, tag in tags if tag is not None}
        return bytes(msgpack.packb([SEALED, *head[:-1], proof]))

    def seal_command(self, data: bytes, to: str, to_life: int | None = None) -> bytes:
        """Seal a command to one robot in this life; None: the life that was heard last.

        The robot's next process will not obey it again.
        """
        head = self._head(to, self._memory.latest_life(to) if to_life is None else to_life, data)
        tag = self.keys.tag(to, head.content)
        return bytes(msgpack.packb([SEALED, *head[:-1], {to: tag} if tag is not None else {}]))

    def _head(self, to: str, to_life: int, data: bytes) -> Envelope:
        self._number += 1
        later = self._later_lives
        life = later.get(to, self._life) if to else max(self._life, *later.values(), 0)
        return Envelope(self._run, self.keys.name, life, self._number, to, to_life, data, b"")

    # -- receiving ----------------------------------------------------------------------------

    def open(
        self,
        data: bytes,
        kind: MessageKind,
        source: str | None = None,
        checked: Envelope | None = None,
    ) -> tuple[str, bytes]:
        """Open an envelope and return (sender, message). `source`: the member that must have sent
        it. `checked`: the same envelope, if this member's tag on it has already been checked.

        Raises ForgedError for anything that is not authentic, for a replay, and for a kind that the
        sender may not send. For authentic messages: IncompatibleError if it belongs to another run,
        LateError or StaleError if it may be a replay, RefusedError if it is an answer that refuses
        a query.
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
        self._memory.take(envelope)
        if kind is MessageKind.COMMAND and envelope.to_life not in self._lives():
            raise StaleError(sender, f"meant for an earlier life of {self.keys.name}")
        if kind in _ANSWERS and envelope.data.startswith(_REFUSAL):
            self._refused(sender, envelope.data)
        return sender, envelope.data

    def _lives(self) -> frozenset[int]:
        return frozenset((self._life, *self._later_lives.values()))

    def _refused(self, receiver: str, data: bytes) -> NoReturn:
        """Handle a refusal: the receiver forgot this life, or has begun another one itself."""
        try:
            _, reason, forgotten = msgpack.unpackb(data, max_array_len=3)
        except (ValueError, TypeError, msgpack.UnpackException, RecursionError):
            raise WireError("refusal is malformed") from None
        if not isinstance(reason, str) or type(forgotten) is not int:
            raise WireError("refusal is malformed")
        if 0 < forgotten < MAX_LIFE - _SPREAD:
            self._later_lives[receiver] = forgotten + 1 + self._life % _SPREAD
        raise RefusedError(f"{receiver} refuses this: {one_line(reason)}")

    def _check_proof(self, envelope: Envelope, kind: MessageKind) -> None:
        content, proof, is_good = envelope.content, envelope.proof, False
        if isinstance(proof, bytes):
            # Commands are for one robot and carry its tag.
            if len(proof) == SIGNATURE_BYTES and kind is not MessageKind.COMMAND:
                is_good = self.keys.is_signed(envelope.sender, content, proof)
        else:
            tag = proof.get(self.keys.name)
            if not isinstance(tag, bytes):
                raise ForgedError("not meant for this member")
            expected = self.keys.tag(envelope.sender, content)
            is_good = expected is not None and hmac.compare_digest(tag, expected)
        if not is_good:
            raise ForgedError("signature is wrong")
