"""The messages of a recording as bytes, whether they go to a file or to viewers.

Every message bears a check over itself and the check before it, so that a byte that is changed
later shows, and where.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, Protocol

from mrbt_mesh.recording.channels import FORMAT
from mrbt_mesh.recording.metadata import RunMetadata

CHECK_BYTES = 8

# Plain data as one line of JSON, in ASCII: what a program says may be no Unicode text.
to_json = json.JSONEncoder(separators=(",", ":")).encode


class MessageSink(Protocol):
    """Where recorders put their messages. Each method may raise OSError, `abandon` excepted."""

    @property
    def epoch_ns(self) -> int:
        """The Unix time at which the clock of the recording's owner was 0."""
        ...

    def write(self, topic: str, at_us: int, data: Mapping[str, Any]) -> None:
        """Add a message; `data` is not empty and fits the channel's schema."""
        ...

    def flush(self) -> None:
        """Hand over what was written."""
        ...

    def abandon(self) -> None:
        """Leave it as it is: it could not be written."""
        ...

    def close(self) -> None:
        """Nothing more comes."""
        ...


def first_check(metadata: Mapping[str, str]) -> bytes:
    """What the check of the first message is over, besides itself."""
    text = json.dumps([FORMAT, dict(metadata)], sort_keys=True, ensure_ascii=False)
    return hashlib.blake2b(text.encode(), digest_size=CHECK_BYTES).digest()


def next_check(before: bytes, number: int, topic: str, at_ns: int, body: bytes) -> bytes:
    """The check of a message: over the one before, and all that it says itself."""
    head = f"{number} {topic} {at_ns} ".encode()
    return hashlib.blake2b(before + head + body, digest_size=CHECK_BYTES).digest()


class MessageEncoder:
    """Makes the messages of one recording, in their order. `number`: how many there were."""

    def __init__(self, metadata: RunMetadata) -> None:
        self.number = 0
        self.epoch_ns = metadata.epoch_ns
        self._check = first_check(metadata.to_values())

    def encode(self, topic: str, at_us: int, data: Mapping[str, Any]) -> tuple[int, bytes]:
        """(its Unix time in nanoseconds, its text); `data` is not empty."""
        self.number += 1
        at_ns = self.epoch_ns + at_us * 1_000
        body = to_json(data).encode()
        self._check = next_check(self._check, self.number, topic, at_ns, body)
        return at_ns, b'%s,"check":"%s"}' % (body[:-1], self._check.hex().encode())
