"""Reads a recording, also one whose writer was killed, and finds bytes that were changed since.

A file that ends in the middle of a record is read up to there. Nothing else about a file is taken
on trust: every problem is reported with the number of its record.
"""

from __future__ import annotations

import contextlib
import json
import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import fastjsonschema
from fastjsonschema import JsonSchemaValueException
from mcap.exceptions import McapError
from mcap.records import Channel, DataEnd, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.channels import CHANNELS, SIGNATURES
from mrbt_mesh.recording.messages import (
    CHECK_BYTES,
    first_check,
    next_check,
    read_bytes,
    signed_content,
)
from mrbt_mesh.recording.metadata import METADATA, RunMetadata

_LENGTH = struct.Struct("<Q")
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


@dataclass(frozen=True)
class Recording:
    """What a file holds. `cut_off_at`: the byte at which it ends in the middle of a record, or
    without its end; None if it was closed.
    """

    path: Path
    metadata: RunMetadata
    records: tuple[RecordedMessage, ...]
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
    """Read the file; raises RecordingError for one that is no recording at all."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None
    return parse_recording(content, path)


def parse_recording(content: bytes, path: Path) -> Recording:
    """The recording of these bytes; `path` is what messages call it."""
    reading = _Reading()
    end = reading.read(content)
    if reading.metadata is None:
        what = reading.problem or "it holds no metadata of mrbt"
        raise RecordingError(f"{path}: is no recording of mrbt: {what}")
    try:
        metadata = RunMetadata.from_values(reading.metadata)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    cut_off = None if reading.is_closed else end
    if _CHECK.search(content, end) is not None:
        # What was cut off by the end of its writer has no whole message behind it.
        number = len(reading.records) + 1
        reading.damage.append(Damage(number, f"the file is damaged at byte {end}"))
        cut_off = None
    records, signatures = tuple(reading.records), tuple(reading.signatures)
    return Recording(path, metadata, records, tuple(reading.damage), cut_off, signatures)


class _Reading:
    """One pass through a file, message by message."""

    def __init__(self) -> None:
        self.metadata: dict[str, str] | None = None
        self.records: list[RecordedMessage] = []
        self.signatures: list[Signature] = []
        self.damage: list[Damage] = []
        self.is_closed = False
        self.problem = ""
        self._schemas: dict[int, tuple[str, str, bytes]] = {}
        self._topics: dict[int, str] = {}
        self._check = b""
        self._number = 0
        self._epoch_ns = 0

    def read(self, content: bytes) -> int:
        """Read as far as it goes; returns the first byte that was not understood."""
        end = 0
        for at, record in _records(content, self):
            end = at
            if isinstance(record, Metadata) and record.name == METADATA and not self.metadata:
                self.metadata = dict(record.metadata)
                self._check = first_check(self.metadata)
                with contextlib.suppress(ValueError):
                    self._epoch_ns = int(self.metadata.get("epoch_ns", ""))
            elif isinstance(record, Schema):
                self._schemas[record.id] = (record.name, record.encoding, record.data)
            elif isinstance(record, Channel):
                self._channel(record.id, record.topic, record.message_encoding, record.schema_id)
            elif isinstance(record, DataEnd):
                self.is_closed = True
                break
            elif isinstance(record, Message) and self.metadata is not None:
                self._message(record)
        return end

    def _channel(self, number: int, topic: str, encoding: str, schema: int) -> None:
        self._topics[number] = topic
        known = CHANNELS.get(topic)
        if known is None:
            return  # of another program
        wanted = (known.name, "jsonschema", known.schema_text)
        if self._schemas.get(schema) != wanted or encoding != "json":
            self.damage.append(Damage(0, f"the schema of {topic} is not that of this format"))

    def _message(self, message: Message) -> None:
        topic, data = self._topics.get(message.channel_id, ""), message.data
        number, expected = message.sequence, self._number + 1
        if number != expected:
            self._say(expected, f"in its place is record {number}: it is missing, or was changed")
        found = _CHECK.search(data, max(0, len(data) - CHECK_LENGTH))
        if found is None or message.publish_time != message.log_time:
            self._number = expected
            self._say(expected, f"a message on {topic or 'no known channel'} without its check")
            return
        body = data[: found.start()] + b"}"
        check, self._check = self._check, bytes.fromhex(found[1].decode())
        fits = [
            each
            for each in (number, expected)
            if next_check(check, each, topic, message.log_time, body) == self._check
        ]
        self._number = number = fits[0] if fits else number
        if not fits:
            self._say(number, f"the message on {topic} was changed: its check does not fit")
        try:
            content = json.loads(data)
            _validator(topic)(content)
            if topic == SIGNATURES:
                self._signature(content, number, check)
        except (ValueError, RecursionError, JsonSchemaValueException) as error:
            self._say(number, f"no message of {topic or 'a known channel'}: {error}")
            return
        del content["check"]
        at_us = (message.log_time - self._epoch_ns) // 1_000
        self.records.append(RecordedMessage(number, topic, at_us, content))

    def _signature(self, content: Mapping[str, Any], number: int, check: bytes) -> None:
        """Raises ValueError."""
        by, is_end, signature = content["by"], content["end"], read_bytes(content["signature"])
        until_us = self.records[-1].at_us if self.records else 0
        wanted = signed_content(number - 1, check, is_end)
        self.signatures.append(Signature(number, by, until_us, is_end, wanted, signature))

    def _say(self, number: int, text: str) -> None:
        self.damage.append(Damage(number, text))


@cache
def _validator(topic: str) -> Callable[[Any], Any]:
    """What raises JsonSchemaValueException for a message that does not fit the channel's schema."""
    if topic not in CHANNELS:
        raise ValueError("there is no such channel")
    made: Callable[[Any], Any] = fastjsonschema.compile(dict(CHANNELS[topic].schema))
    return made


def _records(content: bytes, reading: _Reading) -> Iterator[tuple[int, Any]]:
    """(where it ends, record), as far as records are whole."""
    if not content.startswith(MCAP0_MAGIC):
        reading.problem = "not a valid MCAP file"
        return
    end = len(MCAP0_MAGIC)
    # Chunks, which no recording has, stay packed.
    limit = len(content)
    records = StreamReader(BytesIO(content), emit_chunks=True, record_size_limit=limit).records
    try:
        for record in records:
            # The library takes the rest of a file for a whole record.
            (length,) = _LENGTH.unpack_from(content, end + 1)
            end += 1 + _LENGTH.size + length
            if end > len(content):
                return
            yield end, record
    except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
        reading.problem = str(error) or type(error).__name__
