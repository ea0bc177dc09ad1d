"""Writes a recording: MCAP without chunks, handed to the system after every step.

What was written survives the end of its process, also by SIGKILL.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.wire import RecordingHead
from mrbt_mesh.recording import mcap_file
from mrbt_mesh.recording.channels import BEATS, CHANNELS, SIGNATURES
from mrbt_mesh.recording.folder import open_new
from mrbt_mesh.recording.messages import MessageEncoder
from mrbt_mesh.recording.metadata import RunMetadata

# What a killed robot recorded last is signed up to this much before its end.
SIGN_US = 1_000_000


class RecordingWriter:
    """One recording, in a new file: beside another one where that is there already.

    `keys` sign it every second, and at its end. Raises OSError where the file cannot be written, or
    has come to `limit_bytes`; None: no limit.
    """

    def __init__(
        self,
        path: Path,
        metadata: RunMetadata,
        limit_bytes: int | None = None,
        *,
        beats: bool = False,
        keys: Keys | None = None,
    ) -> None:
        self._limit_bytes = limit_bytes
        self._encoder = MessageEncoder(metadata)
        self._keys = keys
        self._now_us, self._signed_us = 0, -SIGN_US
        # Signed and handed over, and not told yet.
        self._head: RecordingHead | None = None
        self._file = open_new(path)
        self._topics = tuple(topic for topic in CHANNELS if beats or topic != BEATS)
        self._channels = mcap_file.channel_numbers(self._topics)
        self._file.write(mcap_file.begin(self._topics, metadata.to_values()))
        self._file.flush()

    @property
    def epoch_ns(self) -> int:
        """The Unix time at which the clock of the recording's owner was 0."""
        return self._encoder.epoch_ns

    def write(self, topic: str, at_us: int, data: Mapping[str, Any]) -> None:
        """Add a message; `data` is not empty and fits the channel's schema."""
        self._now_us = at_us
        at_ns, text = self._encoder.encode(topic, at_us, data)
        channel, number = self._channels[topic], self._encoder.number
        self._file.write(mcap_file.message(channel, number, at_ns, text))

    def _sign(self, is_end: bool) -> None:
        if self._keys is not None:
            self._signed_us, self._head = self._now_us, self._encoder.head
            self.write(
                SIGNATURES, self._now_us, self._encoder.sign(self._keys, is_end, self._now_us)
            )

    def flush(self, now_us: int) -> None:
        """Hand over what was written: the end of this process does not touch it any more."""
        self._now_us = now_us
        if now_us >= self._signed_us + SIGN_US:
            self._sign(False)
        self._file.flush()
        if self._limit_bytes is not None and self._file.tell() > self._limit_bytes:
            raise OSError(errno.EFBIG, f"it has come to {self._limit_bytes >> 20} MiB (--keep)")

    def take_head(self) -> RecordingHead | None:
        """How far the recording has been signed, once each time."""
        head, self._head = self._head, None
        return head

    def abandon(self) -> None:
        """Close the file as it is: it could not be written."""
        with contextlib.suppress(OSError):
            self._file.close()

    def close(self) -> None:
        """End the file, unless it was abandoned; readers need nothing of what MCAP adds here."""
        if self._file.closed:
            return
        try:
            self._sign(True)
            self._file.write(mcap_file.end(self._topics, self._file.tell()))
        finally:
            self._file.close()
