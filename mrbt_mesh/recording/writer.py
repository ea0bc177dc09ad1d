"""Writes a recording: MCAP without chunks, handed to the system after every step.

What was written survives the end of its process, also by SIGKILL. Every message bears a check over
itself and the check before it, so that a byte that is changed later shows, and where.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.recording.channels import BEATS, CHANNELS, FORMAT
from mrbt_mesh.recording.folder import open_new
from mrbt_mesh.recording.metadata import METADATA, RunMetadata

CHECK_BYTES = 8

# A message of MCAP: opcode and length, then channel, number, and the time twice. The library takes
# as long for it as all the rest takes together, and robots write some hundred a second.
_MESSAGE, _OPCODE = struct.Struct("<BQHIQQ"), 0x05
_HEADER_BYTES = _MESSAGE.size - struct.calcsize("<BQ")

# Plain data as one line of JSON, in ASCII: what a program says may be no Unicode text.
to_json = json.JSONEncoder(separators=(",", ":")).encode


def first_check(metadata: Mapping[str, str]) -> bytes:
    """What the check of the first message is over, besides itself."""
    text = json.dumps([FORMAT, dict(metadata)], sort_keys=True, ensure_ascii=False)
    return hashlib.blake2b(text.encode(), digest_size=CHECK_BYTES).digest()


def next_check(before: bytes, number: int, topic: str, at_ns: int, body: bytes) -> bytes:
    """The check of a message: over the one before, and all that it says itself."""
    head = f"{number} {topic} {at_ns} ".encode()
    return hashlib.blake2b(before + head + body, digest_size=CHECK_BYTES).digest()


class RecordingWriter:
    """One recording, in a new file: beside another one where that is there already.

    Raises OSError where the file cannot be written.
    """

    def __init__(self, path: Path, metadata: RunMetadata, *, beats: bool = False) -> None:
        # It is loaded by those who record alone: it needs some megabytes.
        from mcap.writer import IndexType, Writer

        self._epoch_ns = metadata.epoch_ns
        self._file = open_new(path)
        self._writer = Writer(
            self._file, use_chunking=False, index_types=IndexType.NONE, use_statistics=False
        )
        self._writer.start(profile="", library="mrbt-mesh")
        self._number = 0
        self._channels = {
            topic: self._register(topic) for topic in CHANNELS if beats or topic != BEATS
        }
        values = metadata.to_values()
        self._check = first_check(values)
        # With it, the library hands over the schemas and channels as well.
        self._writer.add_metadata(METADATA, values)
        self._file.flush()

    def _register(self, topic: str) -> int:
        channel = CHANNELS[topic]
        data = json.dumps(channel.schema).encode()
        schema = self._writer.register_schema(channel.name, "jsonschema", data)
        return self._writer.register_channel(topic, "json", schema)

    def write(self, topic: str, at_us: int, data: Mapping[str, Any]) -> None:
        """Add a message; `data` is not empty and fits the channel's schema."""
        self._number += 1
        at_ns = self._epoch_ns + at_us * 1_000
        body = to_json(data).encode()
        self._check = next_check(self._check, self._number, topic, at_ns, body)
        text = b'%s,"check":"%s"}' % (body[:-1], self._check.hex().encode())
        channel, length = self._channels[topic], _HEADER_BYTES + len(text)
        self._file.write(_MESSAGE.pack(_OPCODE, length, channel, self._number, at_ns, at_ns) + text)

    def flush(self) -> None:
        """Hand over what was written: the end of this process does not touch it any more."""
        self._file.flush()

    def abandon(self) -> None:
        """Close the file as it is: it could not be written."""
        with contextlib.suppress(OSError):
            self._file.close()

    def close(self) -> None:
        """End the file; readers need nothing of what is added here."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._file.close()
