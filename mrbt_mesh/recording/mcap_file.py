"""The bytes of a recording that are not its messages: what a file begins and ends with.

A recording is MCAP (https://mcap.dev): magic, header, schemas and channels, one record of metadata,
messages, and an end that repeats schemas and channels. Everything except the messages follows from
the metadata, so a reader can compare it byte by byte.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from functools import cache

from mrbt_mesh.recording.channels import CHANNELS

# The name of the record of metadata.
METADATA = "mrbt"
MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "mrbt-mesh"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, METADATA_RECORD, DATA_END = 1, 2, 3, 4, 5, 12, 15
# Opcode and length of every record.
FRAME = struct.Struct("<BQ")
# The fields of a message before its data: channel, number, log time and publish time.
MESSAGE_FIELDS = struct.Struct("<HIQQ")
NAMES = {
    0: "zeros",
    HEADER: "Header",
    FOOTER: "Footer",
    SCHEMA: "Schema",
    CHANNEL: "Channel",
    6: "Chunk",
    7: "Message Index",
    8: "Chunk Index",
    9: "Attachment",
    10: "Attachment Index",
    11: "Statistics",
    METADATA_RECORD: "Metadata",
    13: "Metadata Index",
    14: "Summary Offset",
    DATA_END: "Data End",
}


def message(channel: int, number: int, at_ns: int, data: bytes) -> bytes:
    """Return one message record."""
    fields = MESSAGE_FIELDS.pack(channel, number, at_ns, at_ns)
    return FRAME.pack(MESSAGE, len(fields) + len(data)) + fields + data


def channel_numbers(topics: Iterable[str]) -> dict[str, int]:
    """Return topic -> the number of its channel."""
    return {topic: number for number, topic in enumerate(topics, start=1)}


def begin(topics: tuple[str, ...], metadata: Mapping[str, str]) -> bytes:
    """Return the beginning of a recording with these channels, up to its first message."""
    return before_metadata(topics) + _metadata(metadata)


@cache
def before_metadata(topics: tuple[str, ...]) -> bytes:
    """Return the beginning that all recordings with these channels share."""
    return MAGIC + _record(HEADER, _text("") + _text(LIBRARY)) + _channels(topics)


def end(topics: tuple[str, ...], place: int) -> bytes:
    """Return the end of a closed recording, after its last message, at this byte of the file."""
    data_end = _record(DATA_END, bytes(4))
    footer = _record(FOOTER, struct.pack("<QQI", place + len(data_end), 0, 0))
    return data_end + _channels(topics) + footer + MAGIC


def read_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Return name and values of a metadata record. Raises ValueError for anything else."""
    name, rest = _read_text(content)
    pairs, _ = _read_bytes(rest)
    values = {}
    while pairs:
        key, pairs = _read_text(pairs)
        values[key], pairs = _read_text(pairs)
    return name, values


@cache
def _channels(topics: tuple[str, ...]) -> bytes:
    schemas: dict[str, int] = {}
    found = b""
    for topic, number in channel_numbers(topics).items():
        channel = CHANNELS[topic]
        if channel.name not in schemas:
            schemas[channel.name] = schema = len(schemas) + 1
            said = _text(channel.name) + _text("jsonschema") + _bytes(channel.schema_text)
            found += _record(SCHEMA, struct.pack("<H", schema) + said)
        said = struct.pack("<HH", number, schemas[channel.name]) + _text(topic) + _text("json")
        found += _record(CHANNEL, said + _bytes(b""))
    return found


def _metadata(values: Mapping[str, str]) -> bytes:
    pairs = b"".join(_text(key) + _text(value) for key, value in values.items())
    return _record(METADATA_RECORD, _text(METADATA) + _bytes(pairs))


def _record(opcode: int, content: bytes) -> bytes:
    return FRAME.pack(opcode, len(content)) + content


def _bytes(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def _text(text: str) -> bytes:
    return _bytes(text.encode())


def _read_bytes(content: bytes) -> tuple[bytes, bytes]:
    """Return length-prefixed bytes, and what follows them."""
    if len(content) < 4:
        raise ValueError("a record ends too early")
    end = 4 + int.from_bytes(content[:4], "little")
    if end > len(content):
        raise ValueError("a record ends too early")
    return content[4:end], content[end:]


def _read_text(content: bytes) -> tuple[str, bytes]:
    found, rest = _read_bytes(content)
    return found.decode(), rest
