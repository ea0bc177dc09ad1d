"""Reads a recording, also one whose writer was killed, and finds bytes that were changed since.

A file that ends in the middle of a record is read up to there. Nothing else about a file is taken
on trust: every problem is reported with the number of its record.
"""

from __future__ import annotations

import contextlib
import json
import re
import struct
import weakref
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import Any, BinaryIO, overload

import fastjsonschema
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.channels import ACTIONS, CHANNELS, DROPPED, FACTS, SIGNATURES
from mrbt_mesh.recording.messages import (
    CHECK_BYTES,
    first_check,
    next_check,
    read_bytes,
    signed_content,
)
from mrbt_mesh.recording.metadata import METADATA, RunMetadata

BUFFER_BYTES = 1 << 16
# Opcode and length of a record; a message's channel, number and times before its data.
_FRAME, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
CHECK_LENGTH = len(',"check":""}') + 2 * CHECK_BYTES
_CHECK = re.compile(rb',"check":"([0-9a-f]{%d})"\}' % (2 * CHECK_BYTES))


class RecordingError(InputError):
    """A file that is no recording, or none that this version reads."""


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """One message: its number in the file, from 1, and its time on the clock of the writer."""

    number: int
    topic: str
    at_us: int
    data: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Damage:
    """Something in a file that its writer did not write so; `number` 0: none of its messages."""

    number: int
    text: str


@dataclass(frozen=True, slots=True)
class Signature:
    """A signature over all messages before it, the last of which is of `until_us`; `content`: what
    it must be for. `number` is its own. `is_end`: nothing follows it.
    """

    number: int
    by: str
    until_us: int
    is_end: bool
    content: bytes
    signature: bytes


class RecordedMessages(Sequence[RecordedMessage]):
    """The messages of a file, read again each time: only their places and times are in memory.

    A message that fits no schema raises ValueError.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.times_us = array("q")
        self.topics: list[str] = []
        self._file = file
        self._places = array("Q")
        self._lengths = array("I")
        self._numbers = array("I")
        self._until: array[int] | None = None
        self._owner: RecordedMessages | None = None
        weakref.finalize(self, file.close)

    def add(self, number: int, topic: str, at_us: int, place: int, length: int) -> None:
        """Note a message of the file."""
        self._numbers.append(number)
        self._lengths.append(length)
        self._places.append(place)
        self.times_us.append(at_us)
        self.topics.append(topic)

    def shifted(self, by_us: int) -> RecordedMessages:
        """The same messages, later by this."""
        found = copy(self)
        found._owner = self  # whose end closes the file
        found.times_us = array("q", [at_us + by_us for at_us in self.times_us])
        return found

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> RecordedMessage: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[RecordedMessage, ...]: ...

    def __getitem__(self, index: int | slice) -> RecordedMessage | tuple[RecordedMessage, ...]:
        if isinstance(index, slice):
            return tuple(self[each] for each in range(*index.indices(len(self))))
        topic = self.topics[index]
        data = _read_message(topic, self._text(index))
        return RecordedMessage(self._numbers[index], topic, self.times_us[index], data)

    def of(self, *topics: str) -> Iterator[RecordedMessage]:
        """Those of some channels; the others are not read."""
        return (self[index] for index, topic in enumerate(self.topics) if topic in topics)

    def _text(self, index: int) -> bytes:
        self._file.seek(self._places[index])
        return self._file.read(self._lengths[index])

    def valid_before(self, end: int) -> list[int]:
        """The indexes of the messages before this one that are still valid there.

        That is what `Channel.stands_for` says; a dropped fact is not valid any more, and the start
        and progress of an action are until it ends. Raises ValueError for malformed messages.
        """
        if self._until is None:
            try:
                self._until = self._ends()
            except (KeyError, TypeError, RecursionError) as error:
                raise ValueError(f"a message is malformed: {error}") from None
        return [index for index in range(end) if self._until[index] >= end]

    def _ends(self) -> array[int]:
        """For each message, the index of the one until which it is valid."""
        never = len(self)
        until, latest = array("I", bytes(4 * never)), dict[tuple[str, ...], int]()
        for index, topic in enumerate(self.topics):
            fields = CHANNELS[topic].stands_for
            data = json.loads(self._text(index)) if fields or topic in (ACTIONS, DROPPED) else {}
            keys, ends = [(topic, *(str(data[field]) for field in fields or ()))], fields is None
            if topic == DROPPED:
                keys = [(FACTS, data["author"], data["name"])]
            elif topic == ACTIONS:
                ends = data["event"] not in ("started", "progress")
                started, progress = (topic, "started"), (topic, "progress")
                keys = [started, progress] if data["event"] != "progress" else [progress]
                if data["event"] not in ("started", "progress", "finished", "stopped"):
                    continue
            for key in keys:
                if key in latest:
                    until[latest.pop(key)] = index
            if not ends:
                latest[keys[0]], until[index] = index, never
        return until


@dataclass(frozen=True)
class Recording:
    """What a file holds. `cut_off_at`: the byte at which it ends in the middle of a record, or
    without its end; None if it was closed.
    """

    path: Path
    metadata: RunMetadata
    records: RecordedMessages
    damage: tuple[Damage, ...] = ()
    cut_off_at: int | None = None
    signatures: tuple[Signature, ...] = ()

    @property
    def begin_us(self) -> int:
        """The time of its first message."""
        return self.records[0].at_us if self.records else 0

    @property
    def name(self) -> str:
        """How it is called where several are compared."""
        return self.path.name


def read_recording(path: Path) -> Recording:
    """Read the file, and check every message; raises RecordingError for one that is no recording
    at all.
    """
    return _read_file(path, True)


def open_recording(path: Path) -> Recording:
    """As `read_recording`, in a small part of the time: messages are checked against their schemas
    only when they are taken.
    """
    return _read_file(path, False)


def _read_file(path: Path, checks_schemas: bool) -> Recording:
    try:
        file = path.open("rb", buffering=BUFFER_BYTES)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    return _read(file, path, checks_schemas)


def parse_recording(content: bytes, path: Path) -> Recording:
    """The recording of these bytes; `path` is what messages call it."""
    return _read(BytesIO(content), path, True)


def _read(file: BinaryIO, path: Path, checks_schemas: bool) -> Recording:
    reading = _Reading(file, checks_schemas)
    try:
        end = reading.read()
        has_more = reading.has_message_behind(end)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    if reading.metadata is None:
        what = reading.problem or "it holds no metadata of mrbt"
        raise RecordingError(f"{path}: is no recording of mrbt: {what}")
    try:
        metadata = RunMetadata.from_values(reading.metadata)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    cut_off = None if reading.is_closed else end
    if has_more:
        # What was cut off by the end of its writer has no whole message behind it.
        number = len(reading.records) + 1
        reading.damage.append(Damage(number, f"the file is damaged at byte {end}"))
        cut_off = None
    damage, signatures = tuple(reading.damage), tuple(reading.signatures)
    return Recording(path, metadata, reading.records, damage, cut_off, signatures)


class _Reading:
    """One pass through a file, message by message."""

    def __init__(self, file: BinaryIO, checks_schemas: bool) -> None:
        self.metadata: dict[str, str] | None = None
        self.records = RecordedMessages(file)
        self.signatures: list[Signature] = []
        self.damage: list[Damage] = []
        self.is_closed = False
        self.problem = ""
        self._file = file
        self._checks_schemas = checks_schemas
        self._schemas: dict[int, tuple[str, str, bytes]] = {}
        self._topics: dict[int, str] = {}
        self._check = b""
        self._number = 0
        self._epoch_ns = 0
        self._size = 0

    def read(self) -> int:
        """Read as far as it goes; returns the first byte that was not understood."""
        file, frame = self._file, _FRAME
        size = self._size = file.seek(0, SEEK_END)
        end = len(MCAP0_MAGIC)
        file.seek(0)
        if file.read(end) != MCAP0_MAGIC:
            self.problem = "not a valid MCAP file"
            return 0
        try:
            while not self.is_closed and end + frame.size <= size:
                opcode, length = frame.unpack(file.read(frame.size))
                begin, end_of_record = end + frame.size, end + frame.size + length
                if end_of_record > size:
                    break
                self._record(opcode, file.read(length), begin)
                end = end_of_record
        except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
            self.problem = str(error) or type(error).__name__
        return end

    def has_message_behind(self, place: int) -> bool:
        """Whether there is a check of a message behind this byte."""
        self._file.seek(place)
        before = b""
        # The file may have grown since.
        while block := self._file.read(min(BUFFER_BYTES, self._size - self._file.tell())):
            if _CHECK.search(before + block) is not None:
                return True
            before = block[-CHECK_LENGTH:]
        return False

    def _record(self, opcode: int, content: bytes, place: int) -> None:
        """Take in one record of MCAP. Chunks, which no recording has, stay packed."""
        if opcode == Opcode.MESSAGE:
            if self.metadata is not None:
                self._message(content, place)
            return
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.METADATA:
            found = Metadata.read(stream)
            if found.name == METADATA and not self.metadata:
                self.metadata = dict(found.metadata)
                self._check = first_check(self.metadata)
                with contextlib.suppress(ValueError):
                    self._epoch_ns = int(self.metadata.get("epoch_ns", ""))
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = (schema.name, schema.encoding, schema.data)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            encoding, schema_id = channel.message_encoding, channel.schema_id
            self._channel(channel.id, channel.topic, encoding, schema_id)
        elif opcode == Opcode.DATA_END:
            self.is_closed = True

    def _channel(self, number: int, topic: str, encoding: str, schema: int) -> None:
        self._topics[number] = topic
        known = CHANNELS.get(topic)
        if known is None:
            return  # of another program
        wanted = (known.name, "jsonschema", known.schema_text)
        if self._schemas.get(schema) != wanted or encoding != "json":
            self.damage.append(Damage(0, f"the schema of {topic} is not that of this format"))

    def _message(self, content: bytes, place: int) -> None:
        channel, number, log_ns, publish_ns = _MESSAGE.unpack_from(content)
        topic, data = self._topics.get(channel, ""), content[_MESSAGE.size :]
        expected = self._number + 1
        if number != expected:
            self._say(expected, f"in its place is record {number}: it is missing, or was changed")
        found = _CHECK.search(data, max(0, len(data) - CHECK_LENGTH))
        if found is None or publish_ns != log_ns:
            self._number = expected
            self._say(expected, f"a message on {topic or 'no known channel'} without its check")
            return
        body = data[: found.start()] + b"}"
        check, self._check = self._check, bytes.fromhex(found[1].decode())
        fits = next(
            (
                each
                for each in (number, expected)
                if next_check(check, each, topic, log_ns, body) == self._check
            ),
            None,
        )
        self._number = number = number if fits is None else fits
        if fits is None:
            self._say(number, f"the message on {topic} was changed: its check does not fit")
        try:
            if topic not in CHANNELS:
                raise ValueError("there is no such channel")
            if self._checks_schemas or topic == SIGNATURES:
                message = _read_message(topic, data)
                if topic == SIGNATURES:
                    self._signature(message, number, check)
        except ValueError as error:
            self._say(number, f"no message of {topic or 'a known channel'}: {error}")
            return
        at_us = (log_ns - self._epoch_ns) // 1_000
        self.records.add(number, topic, at_us, place + _MESSAGE.size, len(data))

    def _signature(self, content: Mapping[str, Any], number: int, check: bytes) -> None:
        """Raises ValueError."""
        by, is_end, signature = content["by"], content["end"], read_bytes(content["signature"])
        times_us = self.records.times_us
        until_us = times_us[-1] if times_us else 0
        wanted = signed_content(number - 1, check, is_end)
        self.signatures.append(Signature(number, by, until_us, is_end, wanted, signature))

    def _say(self, number: int, text: str) -> None:
        self.damage.append(Damage(number, text))


def _read_message(topic: str, text: bytes) -> Mapping[str, Any]:
    """A message without its check; raises ValueError for one that does not fit the schema."""
    try:
        content = json.loads(text)
        _validator(topic)(content)
    except RecursionError as error:
        raise ValueError(str(error)) from None
    del content["check"]
    return dict(content)


@cache
def _validator(topic: str) -> Callable[[Any], Any]:
    """What raises ValueError for a message that does not fit the channel's schema."""
    made: Callable[[Any], Any] = fastjsonschema.compile(dict(CHANNELS[topic].schema))
    return made
