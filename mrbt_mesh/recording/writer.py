"""Writes a recording: MCAP without chunks, passed to the system after every step.

What was written survives the end of the process, even by SIGKILL. A long recording has several
parts, each a file that can be read alone: a later part begins with the state at its beginning. Its
metadata, and so all its checks and signatures, continue from the part before.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.membership.wire import RecordingHead
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.recording import mcap_file
from mrbt_mesh.recording.channels import (
    ACTIONS,
    BEATS,
    CHANNELS,
    DEATHS,
    FACTS,
    PARTS,
    SCENE,
    SIGNATURES,
)
from mrbt_mesh.recording.folder import open_new, open_part, part_path
from mrbt_mesh.recording.messages import MessageEncoder, pack_fact
from mrbt_mesh.recording.metadata import RunMetadata

# A killed robot's recording is signed up to this long before its end.
SIGN_US = 1_000_000
# The number of parts that fit in the limit of a recording.
PARTS_IN_LIMIT = 8
_Message: TypeAlias = tuple[str, int, Mapping[str, Any]]


class Standing:
    """The messages that are still valid by `Channel.stands_for`, except facts."""

    def __init__(self) -> None:
        self._by_key: dict[tuple[object, ...], _Message] = {}
        self._action: list[_Message] = []

    def take(self, topic: str, at_us: int, data: Mapping[str, Any]) -> None:
        """Note a message that was written."""
        fields = CHANNELS[topic].stands_for
        if topic == ACTIONS:
            self._acted(topic, at_us, data)
        elif fields is not None and topic != FACTS:
            self._by_key[topic, *[data[name] for name in fields]] = topic, at_us, data

    def _acted(self, topic: str, at_us: int, data: Mapping[str, Any]) -> None:
        """Note a message about an action.

        Start, progress and cancellation are valid until the action ends.
        """
        event = data["event"]
        if event in ("started", "finished", "stopped"):
            self._action.clear()
        if event not in ("finished", "stopped"):
            self._action.append((topic, at_us, data))

    def messages(self, now_us: int) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """Yield the valid messages.

        A scene lists the robots, so it comes before their positions.
        """
        order = list(CHANNELS)
        listed = sorted(
            [*self._by_key.values(), *self._action],
            key=lambda each: -1 if each[0] == SCENE else order.index(each[0]),
        )
        for topic, at_us, data in listed:
            # A death's age grows with time.
            later = {"ago_us": data["ago_us"] + now_us - at_us} if topic == DEATHS else {}
            yield topic, {**data, **later}


class RecordingWriter:
    """Writes one recording to a new file, with another name if the file exists.

    `keys` sign it every second, and at the end of each part. With `limit_bytes` it has parts, and
    the oldest are removed so that it stays below the limit. Raises OSError if a file cannot be
    written.
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
        self._keys = keys
        self._now_us, self._signed_us = 0, -SIGN_US
        # Signed and flushed, and not yet returned by `take_head`.
        self._head: RecordingHead | None = None
        self._topics = tuple(topic for topic in CHANNELS if beats or topic != BEATS)
        self._channels = mcap_file.channel_numbers(self._topics)
        self._standing = Standing()
        # Number of each finished part that is kept -> its bytes.
        self._kept: dict[int, int] = {}
        self._file = open_new(path)
        self._first = Path(self._file.name)
        self._begin(metadata)

    def _begin(self, metadata: RunMetadata) -> None:
        """Begin a file by writing what precedes its messages."""
        self._metadata, self._encoder = metadata, MessageEncoder(metadata)
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
        self._standing.take(topic, at_us, data)
        channel, number = self._channels[topic], self._encoder.number
        self._file.write(mcap_file.message(channel, number, at_ns, text))

    def _sign(self, is_end: bool) -> None:
        if self._keys is not None:
            self._signed_us, self._head = self._now_us, self._encoder.head
            self.write(
                SIGNATURES, self._now_us, self._encoder.sign(self._keys, is_end, self._now_us)
            )

    def flush(self, now_us: int) -> None:
        """Pass what was written to the system, so that it survives the end of this process."""
        self._now_us = now_us
        if now_us >= self._signed_us + SIGN_US:
            self._sign(False)
        self._file.flush()
        if self._limit_bytes is not None and self._file.tell() > self._limit_bytes:
            text = f"one part of it has come to {self._limit_bytes >> 20} MiB (--keep)"
            raise OSError(errno.EFBIG, text)

    @property
    def is_full(self) -> bool:
        """True if another part should begin as soon as possible."""
        return self._limit_bytes is not None and self._file.tell() > self._part_bytes

    @property
    def _part_bytes(self) -> int:
        assert self._limit_bytes is not None
        return self._limit_bytes // PARTS_IN_LIMIT

    def begin_part(
        self, mission: Mission, facts: Iterable[Entry], about: Mapping[str, Any], now_us: int
    ) -> None:
        """End the file and begin another part with the current state.

        The state consists of these facts and all messages that are still valid. `about` adds fields
        to the message that ends the state.
        """
        self._now_us = now_us
        self._sign(False)
        number, head = self._metadata.part, self._encoder.head
        self._end_file()
        self._kept[number] = self._file.tell()
        obsolete = self._obsolete()
        # Before the other one is closed: at any time, one part of what goes on is locked.
        before, self._file = self._file, open_part(part_path(self._first, number + 1))
        before.close()
        metadata = replace(
            self._metadata,
            part=number + 1,
            after_number=head.number,
            after_check=head.check.hex(),
            kept_from=min(self._kept, default=number + 1),
        )
        if mission.digest != metadata.mission_digest:
            compiled, digest = compile_mission(mission), mission.digest
            metadata = replace(metadata, mission=compiled, mission_digest=digest)
        self._begin(metadata)
        standing = list(self._standing.messages(now_us))
        for entry in facts:
            self.write(FACTS, now_us, pack_fact(entry, 0))
        for topic, data in standing:
            self.write(topic, now_us, data)
        self.write(PARTS, now_us, {"part": number + 1, **about})
        self._sign(False)
        self._file.flush()
        for each in obsolete:
            part_path(self._first, each).unlink(missing_ok=True)

    def _obsolete(self) -> list[int]:
        """Remove parts from those kept, oldest first, until another part fits.

        Return their numbers.
        """
        assert self._limit_bytes is not None
        found = []
        while self._kept and sum(self._kept.values()) + self._part_bytes > self._limit_bytes:
            found.append(min(self._kept))
            del self._kept[found[-1]]
        return found

    def _end_file(self) -> None:
        self._file.write(mcap_file.end(self._topics, self._file.tell()))
        self._file.flush()

    def take_head(self) -> RecordingHead | None:
        """Return how far the recording has been signed, once each time."""
        head, self._head = self._head, None
        return head

    def abandon(self) -> None:
        """Close the file as it is, because it could not be written."""
        with contextlib.suppress(OSError):
            self._file.close()

    def close(self) -> None:
        """End the file, unless it was abandoned. Readers do not need MCAP's end."""
        if self._file.closed:
            return
        try:
            self._sign(True)
            self._end_file()
        finally:
            self._file.close()
