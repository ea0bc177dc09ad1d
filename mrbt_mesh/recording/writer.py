"""Writes a recording: MCAP without chunks, handed to the system after every step.

What was written survives the end of its process, also by SIGKILL.
"""

from __future__ import annotations

import contextlib
import errno
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.recording.channels import BEATS, CHANNELS
from mrbt_mesh.recording.folder import open_new
from mrbt_mesh.recording.messages import MessageEncoder
from mrbt_mesh.recording.metadata import METADATA, RunMetadata

# A message of MCAP: opcode and length, then channel, number, and the time twice. The library takes
# as long for it as all the rest takes together, and robots write some hundred a second.
_MESSAGE, _OPCODE = struct.Struct("<BQHIQQ"), 0x05
_HEADER_BYTES = _MESSAGE.size - struct.calcsize("<BQ")


class RecordingWriter:
    """One recording, in a new file: beside another one where that is there already.

    Raises OSError where the file cannot be written, or has come to `limit_bytes`; None: no limit.
    """

    def __init__(
        self,
        path: Path,
        metadata: RunMetadata,
        limit_bytes: int | None = None,
        *,
        beats: bool = False,
    ) -> None:
        # It is loaded by those who record alone: it needs some megabytes.
        from mcap.writer import IndexType, Writer

        self._limit_bytes = limit_bytes
        self._encoder = MessageEncoder(metadata)
        self._file = open_new(path)
        self._writer = Writer(
            self._file, use_chunking=False, index_types=IndexType.NONE, use_statistics=False
        )
        self._writer.start(profile="", library="mrbt-mesh")
        self._schemas: dict[str, int] = {}
        self._channels = {
            topic: self._register(topic) for topic in CHANNELS if beats or topic != BEATS
        }
        # With it, the library hands over the schemas and channels as well.
        self._writer.add_metadata(METADATA, metadata.to_values())
        self._file.flush()

    @property
    def epoch_ns(self) -> int:
        """The Unix time at which the clock of the recording's owner was 0."""
        return self._encoder.epoch_ns

    def _register(self, topic: str) -> int:
        channel = CHANNELS[topic]
        if channel.name not in self._schemas:
            register = self._writer.register_schema
            self._schemas[channel.name] = register(channel.name, "jsonschema", channel.schema_text)
        return self._writer.register_channel(topic, "json", self._schemas[channel.name])

    def write(self, topic: str, at_us: int, data: Mapping[str, Any]) -> None:
        """Add a message; `data` is not empty and fits the channel's schema."""
        at_ns, text = self._encoder.encode(topic, at_us, data)
        channel, number = self._channels[topic], self._encoder.number
        length = _HEADER_BYTES + len(text)
        self._file.write(_MESSAGE.pack(_OPCODE, length, channel, number, at_ns, at_ns) + text)

    def flush(self) -> None:
        """Hand over what was written: the end of this process does not touch it any more."""
        self._file.flush()
        if self._limit_bytes is not None and self._file.tell() > self._limit_bytes:
            raise OSError(errno.EFBIG, f"it has come to {self._limit_bytes >> 20} MiB (--keep)")

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
