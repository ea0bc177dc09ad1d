"""The messages of a recording: facts and plans as plain data and back, and messages as bytes.

Every message has a check over itself and the previous check, so a byte that is changed later is
found, with its place. A team's keys sign checks, and so everything recorded before.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import msgpack

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.store import BatchProof, Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.wire import RecordingHead
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.observer.episodes import DeathTimes, MajorFault
from mrbt_mesh.recording.channels import FORMAT
from mrbt_mesh.recording.metadata import RunMetadata

LETTERS = "-RSF"
# By status.
STATUS_NAMES = tuple(status.name.lower() for status in Status)


def readable(value: Any) -> Any:
    """Return a fact's value as JSON can show it; only the fact's packed value is exact."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, list | tuple):
        return [readable(each) for each in value]
    if isinstance(value, Mapping):
        return {str(key): readable(each) for key, each in value.items()}
    if value is None or isinstance(value, str | int | float):
        return value
    return str(value)


def pack_fact(entry: Entry, number: int) -> dict[str, Any]:
    """Return a fact as a message of the channel of facts."""
    (counter, nonce), sequence = entry.version
    data: dict[str, Any] = {
        "number": number,
        "author": entry.author,
        "name": entry.name,
        "version": {"counter": counter, "nonce": nonce, "sequence": sequence},
        "value": readable(entry.value),
        "packed": _text(entry.packed),
        "hash": f"{entry.hash:032x}",
    }
    if entry.proof is not None:
        proof = entry.proof
        data["proof"] = {"hashes": _text(proof.hashes), "signature": _text(proof.signature)}
    return data


def unpack_fact(data: Mapping[str, Any]) -> Entry:
    """Return the fact of such a message, made from its packed value.

    Raises ValueError if the message is malformed, or if its other fields do not fit that value.
    """
    try:
        version = data["version"]
        incarnation = Incarnation(int(version["counter"]), str(version["nonce"]))
        packed = read_bytes(data["packed"])
        value = msgpack.unpackb(packed, strict_map_key=False)
        proof = None
        if "proof" in data:
            shown = data["proof"]
            proof = BatchProof(read_bytes(shown["hashes"]), read_bytes(shown["signature"]))
        made = Version(incarnation, int(version["sequence"]))
        entry = parse_entry(data["author"], data["name"], made, value, proof)
        number = data["number"]
    except ValueError as error:
        raise ValueError(f"the fact is malformed: {error}") from None
    except (KeyError, TypeError, AttributeError, msgpack.UnpackException):
        raise ValueError("the fact is malformed: a field is missing or of another kind") from None
    wanted = pack_fact(entry, number)
    for field, value in data.items():
        if not same(wanted.get(field), value):
            raise ValueError(f"the fact's {field} is not that of the rest of it")
    return entry


def same(left: Any, right: Any) -> bool:
    """Return whether two plain values are equal and of equal types: 1 is neither 1.0 nor true."""
    if type(left) is not type(right):
        return False
    if isinstance(left, dict):
        return list(left) == list(right) and all(same(left[key], right[key]) for key in left)
    if isinstance(left, list):
        return len(left) == len(right) and all(map(same, left, right))
    return bool(left == right)


def pack_alive(alive: Mapping[str, Incarnation]) -> dict[str, str]:
    """Robot -> incarnation, sorted."""
    return {robot: str(alive[robot]) for robot in sorted(alive)}


def read_incarnation(text: str) -> Incarnation:
    """The inverse of `str(incarnation)`; raises ValueError."""
    counter, point, nonce = text.partition(".")
    if not point:
        raise ValueError(f"{text!r} is not an incarnation")
    return Incarnation(int(counter), nonce)


def pack_plan(
    plan: Plan, number: int, facts: int, digest: bytes, alive: Mapping[str, Incarnation]
) -> dict[str, Any]:
    """Return a plan as a message of the channel of plans.

    The statuses of T_G's nodes have their own channel. `facts` is the number of the last change of
    facts that the plan was made from, `digest` the digest of the facts.
    """
    content = plan.to_json()
    # That is `plan.packed`, used only here.
    whole = hashlib.blake2b(msgpack.packb(content), digest_size=16).hexdigest()
    del content["statuses"]
    return {
        "number": number,
        "facts": facts,
        "facts_digest": digest.hex(),
        "alive": pack_alive(alive),
        "digest": plan.digest.hex(),
        "hash": whole,
        **content,
    }


def pack_statuses(statuses: Iterable[int]) -> str:
    """Return the statuses of a tree's nodes in preorder, one letter each."""
    return "".join([LETTERS[status] for status in statuses])


def unpack_statuses(letters: str) -> bytes:
    """The inverse of `pack_statuses`; raises ValueError."""
    return bytes(map(LETTERS.index, letters))


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def read_bytes(text: str) -> bytes:
    """Decode base64 of a message.

    Raises ValueError, also for text that `_text` would write differently.
    """
    try:
        found = base64.b64decode(text, validate=True)
    except binascii.Error as error:
        raise ValueError(str(error)) from None
    if _text(found) != text:
        raise ValueError("base64 with bits that mean nothing")
    return found


def pack_death(fault: MajorFault, now_us: int) -> dict[str, Any]:
    """Return a message of the channel of deaths.

    All its times are durations, so no clock matters.
    """
    return {
        "robot": fault.robot,
        "incarnation": str(fault.incarnation),
        "ago_us": now_us - fault.at_us,
        "detected_after_us": fault.detected_after_us,
        "reassigned_after_us": fault.reassigned_after_us,
        "replacement": fault.replacement,
        "exact": fault.exact,
    }


def unpack_death(data: Mapping[str, Any], now_us: int) -> tuple[str, Incarnation, DeathTimes]:
    """The inverse of `pack_death`; raises ValueError."""
    at_us = now_us - data["ago_us"]
    detected_us, reassigned_us = (
        None if data[name] is None else at_us + data[name]
        for name in ("detected_after_us", "reassigned_after_us")
    )
    times = DeathTimes(at_us, detected_us, reassigned_us, data["replacement"], data["exact"])
    return data["robot"], read_incarnation(data["incarnation"]), times


def pack_head(robot: str, incarnation: Incarnation, head: RecordingHead) -> dict[str, Any]:
    """Return a message of the channel of heads."""
    said = {"number": head.number, "head": head.check.hex()}
    return {"robot": robot, "incarnation": str(incarnation), **said}


def pack_beat(source: str, data: bytes, sent: bool) -> dict[str, Any]:
    """Return a message of the channel of heartbeats."""
    return {"source": source, "sent": sent, "data": _text(data)}


# -- messages as bytes ----------------------------------------------------------------------------

# A signature is over a check, so nobody may find other messages with the same check.
CHECK_BYTES = 16

# Plain data as one line of ASCII JSON: texts of programs may be invalid Unicode.
to_json = json.JSONEncoder(separators=(",", ":")).encode


class MessageSink(Protocol):
    """Where recorders put their messages. Each method except `abandon` may raise OSError."""

    @property
    def epoch_ns(self) -> int:
        """The Unix time at which the clock of the recording's owner was 0."""

    def write(self, topic: str, at_us: int, data: Mapping[str, Any]) -> None:
        """Add a message; `data` is not empty and fits the channel's schema."""

    def flush(self, now_us: int) -> None:
        """Pass on what was written; `now_us` is on the same clock as in `write`."""

    @property
    def is_full(self) -> bool:
        """True if another part should begin as soon as possible."""

    def begin_part(
        self, mission: Mission, facts: Iterable[Entry], about: Mapping[str, Any], now_us: int
    ) -> None:
        """Begin another part with the current state; `about` adds fields to its message."""

    def abandon(self) -> None:
        """Leave the recording as it is, because it could not be written."""

    def close(self) -> None:
        """End the recording: no more messages come."""


def first_check(metadata: Mapping[str, str]) -> bytes:
    """Return the check before the first message, which is over the metadata."""
    text = json.dumps([FORMAT, dict(metadata)], sort_keys=True, ensure_ascii=False)
    return hashlib.blake2b(text.encode(), digest_size=CHECK_BYTES).digest()


def next_check(before: bytes, number: int, topic: str, at_ns: int, body: bytes) -> bytes:
    """Return the check of a message, over the previous check and the whole message."""
    head = f"{number} {topic} {at_ns} ".encode()
    return hashlib.blake2b(before + head + body, digest_size=CHECK_BYTES).digest()


def signed_content(number: int, check: bytes, is_end: bool, at_ns: int) -> bytes:
    """Return the bytes that a signature in a recording signs.

    They cover all messages up to the one with this number and check, and the time of the
    signature's own message. `is_end`: nothing follows it.
    """
    return b"mrbt recording\0" + bytes(msgpack.packb([number, check, is_end, at_ns]))


class MessageEncoder:
    """Encodes the messages of one recording in order. `number` is how many there were."""

    def __init__(self, metadata: RunMetadata) -> None:
        self.number = metadata.after_number
        self.epoch_ns = metadata.epoch_ns
        self._check = first_check(metadata.to_values())

    def encode(self, topic: str, at_us: int, data: Mapping[str, Any]) -> tuple[int, bytes]:
        """Return (Unix time in nanoseconds, text) of a message; `data` is not empty."""
        self.number += 1
        at_ns = self._unix_ns(at_us)
        body = to_json(data).encode()
        self._check = next_check(self._check, self.number, topic, at_ns, body)
        return at_ns, b'%s,"check":"%s"}' % (body[:-1], self._check.hex().encode())

    def _unix_ns(self, at_us: int) -> int:
        return self.epoch_ns + at_us * 1_000

    @property
    def head(self) -> RecordingHead:
        """The number and the check of the last message, which covers all messages so far."""
        return RecordingHead(self.number, self._check)

    def sign(self, keys: Keys, is_end: bool, at_us: int) -> dict[str, Any]:
        """Return a message of the channel of signatures for all messages so far, to be written at
        `at_us`.
        """
        content = signed_content(self.number, self._check, is_end, self._unix_ns(at_us))
        signature = keys.sign(content)
        return {"by": keys.name, "end": is_end, "signature": _text(signature)}
