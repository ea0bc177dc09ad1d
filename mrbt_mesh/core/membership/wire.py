"""Messages on the wire: their contents, their encoding, and what is refused.

A message is one msgpack list: schema version, kind, the mission's digest and name, run, sender,
body. `decode` checks all but the body; `parse_heartbeat`, `parse_entries` and `parse_pull` check
bodies. Malformed input is refused with a WireError, and no other exception escapes.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import msgpack

from mrbt_mesh.core.facts.records import MAX_NAME, OPERATORS
from mrbt_mesh.core.facts.store import (
    MAX_VALUE_BYTES,
    PARTS,
    BatchProof,
    Entry,
    Incarnation,
    Version,
    parse_entry,
    plain_value,
)
from mrbt_mesh.core.mission.names import is_robot_id

SCHEMA = 16
MAX_MESSAGE_BYTES = 4 << 20
# The most items of one list, and of all lists of a message together: an empty list takes one byte
# in a message, but 64 in memory.
MAX_ITEMS, MAX_ALL_ITEMS = 100_000, 300_000
SHORT_BYTES, LONG_BYTES = 4 << 10, 64 << 10
MAX_NONCE = 32
MAX_TREE_NODES = 4_096  # a larger tree of a local task reports no statuses
DIGEST_BYTES, HEAD_BYTES, MAX_SIGNATURE_BYTES = 8, 16, 64
# In thousandths: a million units, and one full turn, in either direction.
MAX_COORDINATE, MAX_HEADING = 10**9, 6_284
# What messages of a team with keys begin with; see `envelope`.
SEALED = "mrbt-sealed-2"


class WireError(ValueError):
    """A message that is refused; the text is the reason."""


class IncompatibleError(WireError):
    """A well-formed message of another mission, run or schema version."""


class MessageKind(enum.StrEnum):
    """HEARTBEAT and FACT (a batch) are published. PULL and COMMAND are queries; STATE (a page of
    facts) and ANSWER are their replies.
    """

    HEARTBEAT = "beat"
    FACT = "fact"
    PULL = "pull"
    STATE = "state"
    COMMAND = "command"
    ANSWER = "answer"


@dataclass(frozen=True, slots=True)
class Header:
    """What every message starts with. `mission` is the digest's first 16 hexadecimal digits."""

    mission: str
    mission_name: str
    run: str
    sender: str


@dataclass(frozen=True, slots=True)
class Suspicion:
    """The sender's suspicion of another robot's incarnation.

    `is_token_lost`: the sender has lost its liveliness token. `is_dead`: the sender has declared it
    dead. `is_probe`: the sender has had no news of it for too long, and asks everybody for some.
    `report`: the last signed report of that incarnation that the sender knows, if any: it proves to
    a robot that an incarnation unknown to it was its own.
    """

    robot: str
    incarnation: Incarnation
    is_token_lost: bool
    is_dead: bool
    is_probe: bool
    report: SelfReport | None = None

    @property
    def flags(self) -> int:
        """The three flags as one number."""
        return int(self.is_token_lost) + 2 * int(self.is_dead) + 4 * int(self.is_probe)


@dataclass(frozen=True, slots=True)
class SelfReport:
    """A robot's report about itself, sent in every heartbeat and relayed by others.

    `number` counts its heartbeats. `result`: the mission's status as the robot sees it.
    `signature`: the robot's own, in a team with keys; see `signed_reports`.
    """

    incarnation: Incarnation
    number: int
    plan_digest: bytes
    has_joined: bool
    result: int
    signature: bytes = b""


@dataclass(frozen=True, slots=True)
class Position:
    """Where a robot is, in thousandths of the map's unit. `heading`: in milliradians from the x
    axis towards the y axis, None if unknown.
    """

    x: int
    y: int
    heading: int | None = None

    def in_units(self) -> dict[str, float | None]:
        """Return the position in units of the map, and radians."""
        heading = None if self.heading is None else self.heading / 1_000
        return {"x": self.x / 1_000, "y": self.y / 1_000, "heading": heading}


@dataclass(frozen=True, slots=True)
class RecordingHead:
    """How far a robot's process has signed its recording: up to message `number`. `check` covers
    all messages before that one.
    """

    number: int
    check: bytes


# What a robot requests of others: an activation, and the party that it requests it for.
Request: TypeAlias = tuple[str, str]


@dataclass(frozen=True, slots=True)
class RequestAnswer:
    """The sender grants what heartbeat `number` of `robot` requests for this party."""

    party: str
    robot: str
    number: int


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """One heartbeat. `statuses`: of T_i, T_A, T_G and T_Li; `progress`: in percent.

    `relays`: robot -> its newest self-report that the sender knows. `request` and `answers`: those
    of a feature. `members_digest`: of the robots that the sender counts on. `position`: as reported
    by the robot. `tree_statuses`: statuses of the nodes, in preorder, of the tree that carries out
    its local task, empty if there is none. `recorded`: how far it has signed its recording, None if
    it does not. `work_ms`: how long the action of its local task has been running, 0 without one.
    `unix_us`: the sender's wall clock, in missions with jobs; `steady_us`: its steady clock, in
    missions in which robots use it to stop in time. Other missions omit them, so they take no bytes
    there.
    """

    report: SelfReport
    is_leaving: bool
    fact_digest: bytes
    statuses: tuple[int, ...]
    progress: int
    suspicions: tuple[Suspicion, ...]
    relays: Mapping[str, SelfReport]
    request: Request | None = None
    answers: tuple[RequestAnswer, ...] = ()
    members_digest: bytes = bytes(DIGEST_BYTES)
    position: Position | None = None
    tree_statuses: bytes = b""
    recorded: RecordingHead | None = None
    work_ms: int = 0
    unix_us: int | None = None
    steady_us: int | None = None


def encode(header: Header, kind: MessageKind, body: Any) -> bytes:
    """Encode a message."""
    head = [SCHEMA, str(kind), header.mission, header.mission_name, header.run, header.sender]
    return bytes(msgpack.packb([*head, body]))


def decode(data: bytes, mine: Header, kind: MessageKind) -> tuple[str, Any]:
    """Decode a message of the expected kind. Returns (sender, body).

    Raises IncompatibleError if schema version, mission or run differ, WireError if the message is
    malformed or too large.
    """
    if len(data) > MAX_MESSAGE_BYTES:
        raise WireError(f"message of {len(data)} bytes, at most {MAX_MESSAGE_BYTES} are read")
    try:
        message = unpacked(data, MAX_VALUE_BYTES)
    except (ValueError, TypeError, msgpack.UnpackException, RecursionError) as error:
        raise WireError(f"not msgpack: {error}") from error
    if not isinstance(message, list) or not message or message[0] != SCHEMA:
        version = message[0] if isinstance(message, list) and message else None
        if version == SEALED:
            raise IncompatibleError("signed: this team has keys, and there are none here (--keys)")
        if isinstance(version, int) and len(message) > 5:
            raise IncompatibleError(f"wire schema {version} (ours is {SCHEMA})")
        raise WireError("not a message of this protocol")
    if len(message) != 7 or not all(isinstance(part, str) for part in message[1:6]):
        raise WireError("header is malformed")
    _, found, mission, name, run, sender, body = message
    if not is_robot_id(sender) and sender != "":
        raise WireError("sender is not a robot id")
    if mission != mine.mission:
        raise IncompatibleError(
            f"mission {name[:64]!r} with digest {mission[:16]} (ours is {mine.mission_name!r}, "
            f"{mine.mission}): all robots of a team need the same mission file"
        )
    if run != mine.run:
        raise IncompatibleError(f"run {run[:64]!r} (ours is {mine.run!r})")
    if found != kind:
        raise WireError(f"kind {found[:16]!r} where {kind} is expected")
    return sender, body


def unpacked(data: bytes, longest: int) -> Any:
    """Unpack a message to plain data. No text or binary data may be longer than `longest`.

    Memory use is a small multiple of the message's size, whatever it contains. Unpacking a list
    reserves memory for the announced number of items before any of them is read, so longer messages
    are first skipped through without keeping anything. Raises ValueError, TypeError or
    msgpack.UnpackException for malformed data.
    """
    if len(data) > SHORT_BYTES:
        unpacker = msgpack.Unpacker(max_buffer_size=len(data))
        unpacker.feed(data)
        unpacker.skip()
    items = 0

    def count(found: Any) -> Any:
        nonlocal items
        items += len(found)
        if items > MAX_ALL_ITEMS:
            raise ValueError(f"more than {MAX_ALL_ITEMS} items")
        return found

    is_long = len(data) > LONG_BYTES
    return msgpack.unpackb(
        data,
        list_hook=count if is_long else None,
        object_hook=count if is_long else None,
        max_str_len=longest,
        max_bin_len=longest,
        max_array_len=min(MAX_ITEMS, len(data)),
        max_map_len=min(MAX_ITEMS, len(data)),
        max_ext_len=0,
    )


def _incarnation(counter: Any, nonce: Any) -> Incarnation:
    if type(counter) is not int or not 0 <= counter < 1 << 53:
        raise WireError("incarnation counter is malformed")
    if not isinstance(nonce, str) or len(nonce) > MAX_NONCE or not nonce.isprintable():
        raise WireError("incarnation nonce is malformed")
    return Incarnation(counter, nonce)


def _robot(value: Any) -> str:
    if not isinstance(value, str) or not is_robot_id(value):
        raise WireError("robot id is malformed")
    return value


def _author(value: Any) -> str:
    return OPERATORS if value == OPERATORS else _robot(value)


def _count(value: Any, high: int = (1 << 53) - 1) -> int:
    if type(value) is not int or not 0 <= value <= high:
        raise WireError("number out of range")
    return value


def _digest(value: Any, size: int = DIGEST_BYTES) -> bytes:
    if not isinstance(value, bytes) or len(value) != size:
        raise WireError("digest is malformed")
    return value


def _rows(value: Any, *widths: int) -> list[list[Any]]:
    if not isinstance(value, list):
        raise WireError("table is malformed")
    for row in value:
        if not isinstance(row, list) or len(row) not in widths:
            raise WireError("table is malformed")
    return value


def pack_heartbeat(heartbeat: Heartbeat) -> list[Any]:
    """Convert a heartbeat to plain data."""
    report, where, head = heartbeat.report, heartbeat.position, heartbeat.recorded
    return [
        *report.incarnation,
        report.number,
        int(report.has_joined) + 2 * int(heartbeat.is_leaving),
        report.plan_digest,
        heartbeat.fact_digest,
        heartbeat.members_digest,
        list(heartbeat.statuses),
        report.result,
        heartbeat.progress,
        [_pack_suspicion(suspicion) for suspicion in heartbeat.suspicions],
        pack_reports(heartbeat.relays),
        list(heartbeat.request) if heartbeat.request is not None else None,
        [[each.party, each.robot, each.number] for each in heartbeat.answers],
        None if where is None else [where.x, where.y, where.heading],
        heartbeat.tree_statuses,
        None if head is None else [head.number, head.check],
        report.signature,
        heartbeat.work_ms,
        *_clocks(heartbeat),
    ]


def _pack_suspicion(suspicion: Suspicion) -> list[Any]:
    row = [suspicion.robot, *suspicion.incarnation, suspicion.flags]
    report = suspicion.report
    return row if report is None else [*row, *_pack_report(report)]


def _pack_report(report: SelfReport) -> list[Any]:
    """Convert everything but its incarnation."""
    joined, signature = int(report.has_joined), report.signature
    row = [report.number, report.plan_digest, joined, report.result]
    return [*row, signature] if signature else row


def _clocks(heartbeat: Heartbeat) -> tuple[int | None, ...]:
    if heartbeat.steady_us is not None:
        return heartbeat.unix_us, heartbeat.steady_us
    return () if heartbeat.unix_us is None else (heartbeat.unix_us,)


def pack_reports(reports: Mapping[str, SelfReport]) -> list[list[Any]]:
    """Convert self-reports of several robots to plain data."""
    return [[robot, *r.incarnation, *_pack_report(r)] for robot, r in reports.items()]


def parse_reports(rows: Any) -> dict[str, SelfReport]:
    """Parse the output of `pack_reports`. Raises WireError."""
    return dict([_relay(row) for row in _rows(rows, *_REPORT_WIDTHS)])


def parse_heartbeat(
    body: Any, is_new_relay: Callable[[list[Any]], bool] = lambda _: True
) -> Heartbeat:
    """Parse the output of `pack_heartbeat`. Raises WireError.

    Relays, which are most of a heartbeat in a large team, are parsed only if `is_new_relay(row)` is
    true for the unchecked row [robot, counter, nonce, number, ...].
    """
    if not isinstance(body, list) or len(body) not in (19, 20, 21):
        raise WireError("beat is malformed")
    counter, nonce, number, flags, plan, facts, alive, statuses, result, progress, *tables = body
    suspicions, relays, request, answers, where, tree, head, signature, work_ms, *clocks = tables
    flags = _count(flags, 3)
    if not isinstance(statuses, list) or len(statuses) != 4:
        raise WireError("beat statuses are malformed")
    return Heartbeat(
        SelfReport(
            _incarnation(counter, nonce),
            _count(number),
            _digest(plan),
            bool(flags & 1),
            _count(result, 3),
            _signature(signature),
        ),
        bool(flags & 2),
        _digest(facts),
        tuple(_count(status, 3) for status in statuses),
        _count(progress, 100),
        tuple(map(_suspicion, _rows(suspicions, *_SUSPICION_WIDTHS))),
        dict([_relay(row) for row in filter(is_new_relay, _rows(relays, *_REPORT_WIDTHS))]),
        _request(request),
        tuple(RequestAnswer(_name(p), _robot(r), _count(n)) for p, r, n in _rows(answers, 3)),
        _digest(alive),
        _position(where),
        _tree_statuses(tree),
        _recording_head(head),
        _count(work_ms),
        *(None if each is None else _count(each) for each in clocks),
    )


def urgent_part(data: bytes) -> tuple[Any, ...] | None:
    """Return the part of an unchecked heartbeat that others act on at once when it changes.

    None if the heartbeat is always urgent (it asks for news or carries a request or answers), or
    cannot be read here.
    """
    if len(data) > SHORT_BYTES:
        return None
    try:
        body = unpacked(data, MAX_VALUE_BYTES)[6]
        counter, nonce, _, flags, plan, facts, members, _, result, _, *tables = body
        suspicions, _, request, answers, *_ = tables
        is_urgent = request or answers or any(row[3] & 4 for row in suspicions)
    except (ValueError, TypeError, LookupError, msgpack.UnpackException, RecursionError):
        return None
    part = counter, nonce, flags, plan, facts, members, result, suspicions
    return None if is_urgent else part


# Widths with and without a report's signature; a suspicion may carry no report at all.
_REPORT_WIDTHS = 7, 8
_SUSPICION_WIDTHS = 4, 8, 9


def _relay(row: list[Any]) -> tuple[str, SelfReport]:
    robot, counter, nonce, *rest = row
    return _robot(robot), _report(_incarnation(counter, nonce), rest)


def _report(incarnation: Incarnation, rest: list[Any]) -> SelfReport:
    number, digest, joined, result, *signature = rest
    return SelfReport(
        incarnation,
        _count(number),
        _digest(digest),
        bool(_count(joined, 1)),
        _count(result, 3),
        _signature(*signature),
    )


def _suspicion(row: list[Any]) -> Suspicion:
    robot, counter, nonce, flags, *rest = row
    incarnation, flags = _incarnation(counter, nonce), _count(flags, 7)
    report = _report(incarnation, rest) if rest else None
    are = bool(flags & 1), bool(flags & 2), bool(flags & 4)
    return Suspicion(_robot(robot), incarnation, *are, report)


def _signature(value: Any = b"") -> bytes:
    if not isinstance(value, bytes) or len(value) > MAX_SIGNATURE_BYTES:
        raise WireError("signature of a report is malformed")
    return value


def _name(value: Any) -> str:
    if not isinstance(value, str) or len(value) > MAX_NAME:
        raise WireError("name is malformed")
    return value


def _position(value: Any) -> Position | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 3:
        raise WireError("position is malformed")
    x, y, heading = value
    turned = 0 if heading is None else heading
    for number, most in ((x, MAX_COORDINATE), (y, MAX_COORDINATE), (turned, MAX_HEADING)):
        if type(number) is not int or not -most <= number <= most:
            raise WireError("position is malformed")
    return Position(x, y, heading)


def _tree_statuses(value: Any) -> bytes:
    if not isinstance(value, bytes) or len(value) > MAX_TREE_NODES or max(value, default=0) > 3:
        raise WireError("statuses of a tree are malformed")
    return value


def _recording_head(value: Any) -> RecordingHead | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2:
        raise WireError("head of a recording is malformed")
    return RecordingHead(_count(value[0]), _digest(value[1], HEAD_BYTES))


def _request(value: Any) -> Request | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2:
        raise WireError("request is malformed")
    return _name(value[0]), _name(value[1])


def pack_entries(entries: Iterable[Entry]) -> list[Any]:
    """Convert entries to plain data, grouped by author and version, so that a batch stays whole.

    Each group ends with the proof of its batch.
    """
    groups: dict[tuple[str, Version], list[list[Any]]] = {}
    proofs: dict[tuple[str, Version], list[bytes]] = {}
    for entry in entries:
        batch = (entry.author, entry.version)
        groups.setdefault(batch, []).append([entry.name, plain_value(entry.packed)])
        if entry.proof is not None:
            proofs[batch] = [entry.proof.hashes, entry.proof.signature]
    return [
        [a, *v.incarnation, v.sequence, rows, proofs.get((a, v))] for (a, v), rows in groups.items()
    ]


def parse_entries(body: Any) -> tuple[list[Entry], int]:
    """Return (well-formed entries, number of malformed ones left out). Raises WireError if `body`
    or a row is malformed.
    """
    entries: list[Entry] = []
    malformed = 0
    for author, counter, nonce, sequence, rows, shown in _rows(body, 6):
        version = Version(_incarnation(counter, nonce), _count(sequence))
        author, proof = _author(author), _proof(shown)
        for name, value in _rows(rows, 2):
            try:
                entries.append(parse_entry(author, name, version, value, proof))
            except (ValueError, TypeError):
                malformed += 1
    return entries, malformed


def _proof(value: Any) -> BatchProof | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2:
        raise WireError("proof of a batch is malformed")
    hashes, signature = value
    if not isinstance(hashes, bytes) or not isinstance(signature, bytes):
        raise WireError("proof of a batch is malformed")
    return BatchProof(hashes, signature)


def parse_pull(body: Any) -> tuple[Mapping[str, bytes], bytes, Mapping[str, bytes]]:
    """Parse a pull. Returns author -> 16-byte digest, the digest of the asker's alive set, and for
    authors with many entries the digests of their parts, see `FactMap.part_digests`.

    Raises WireError.
    """
    if not isinstance(body, list) or len(body) != 3:
        raise WireError("version summary is malformed")
    if not isinstance(body[0], dict) or not isinstance(body[2], dict):
        raise WireError("version summary is malformed")
    summary = {_author(author): _digest(digest, 16) for author, digest in body[0].items()}
    parts = {_author(a): _digest(digests, PARTS * 8) for a, digests in body[2].items()}
    return summary, _digest(body[1]), parts


# How an agent writes and reads messages; several agents in one process may share the work.
WriteHeartbeat: TypeAlias = Callable[[Heartbeat, Header], bytes]
# (robot under whose key it was published, message, own header, which relays may be news)
ReadHeartbeat: TypeAlias = Callable[[str, bytes, Header, Callable[[list[Any]], bool]], Heartbeat]
# (robot under whose key it was published, message, own header)
ReadBatch: TypeAlias = Callable[[str, bytes, Header], tuple[list[Entry], int]]


def write_heartbeat(heartbeat: Heartbeat, mine: Header) -> bytes:
    """Encode a heartbeat as a message."""
    return encode(mine, MessageKind.HEARTBEAT, pack_heartbeat(heartbeat))


def read_heartbeat(
    source: str, data: bytes, mine: Header, is_new_relay: Callable[[list[Any]], bool]
) -> Heartbeat:
    """Read a published heartbeat. Relays that are not news may be left out. Raises WireError."""
    return parse_heartbeat(_body(source, data, mine, MessageKind.HEARTBEAT), is_new_relay)


def read_batch(source: str, data: bytes, mine: Header) -> tuple[list[Entry], int]:
    """Return (a published batch's entries, number of malformed ones). Raises WireError."""
    entries, malformed = parse_entries(_body(source, data, mine, MessageKind.FACT))
    if any(entry.author not in (source, OPERATORS) for entry in entries):
        raise WireError(f"{source} published entries of another author")
    return entries, malformed


def _body(source: str, data: bytes, mine: Header, kind: MessageKind) -> Any:
    sender, body = decode(data, mine, kind)
    if sender != source:
        raise WireError(f"sender {sender} published under the key of {source}")
    return body
