"""Reads recordings, even of writers that were killed, and finds bytes changed later.

Two kinds of damage are distinguished. A file that ends in the middle of a record, possibly followed
by zeros as after a power cut, is read up to there. Anything else that the writer did not write is
reported with the number of its record, or with the byte: every byte of a file is compared or
covered by a check.
"""

from __future__ import annotations

import contextlib
import json
import re
import struct
import weakref
from array import array
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Self, overload

import fastjsonschema

from mrbt_mesh.errors import FileError, InputError
from mrbt_mesh.recording import mcap_file
from mrbt_mesh.recording.channels import (
    ACTIONS,
    BEATS,
    CHANNELS,
    DROPPED,
    FACTS,
    PARTS,
    SIGNATURES,
)
from mrbt_mesh.recording.folder import (
    READ_BYTES,
    first_part,
    is_finished,
    open_regular,
    parts_of,
)
from mrbt_mesh.recording.messages import (
    CHECK_BYTES,
    first_check,
    next_check,
    read_bytes,
    signed_content,
    to_json,
)
from mrbt_mesh.recording.metadata import OBSERVER, NamedRecording, RunMetadata

CHECK_LENGTH = len(',"check":""}') + 2 * CHECK_BYTES
_CHECK = re.compile(rb',"check":"([0-9a-f]{%d})"\}' % (2 * CHECK_BYTES))


class RecordingError(InputError):
    """The file is no recording, or none that this version reads."""


class EmptyRecordingError(RecordingError):
    """The writer, or the machine, ended when the file had only been begun."""


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """A message with its number in the file, from 1, and its time on the writer's clock."""

    number: int
    topic: str
    at_us: int
    data: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Damage:
    """Something in a file that its writer did not write. `number` is 0 if it is in no message.

    A torn end, as left by the end of a process or a power cut, is not damage.
    """

    number: int
    text: str


@dataclass(frozen=True, slots=True)
class Signature:
    """A signature over all messages before it.

    The last of these has the time `until_us` and the `check`. `content` is what must be signed.
    `number` is the signature's own number. `is_end`: nothing may follow it. If there is no message
    before it, `until_us` is its own time, which it signs too.
    """

    number: int
    by: str
    until_us: int
    is_end: bool
    check: bytes
    content: bytes
    signature: bytes


class RecordedMessages(Sequence[RecordedMessage]):
    """The messages of a file, read from it on each access: only positions and times are in memory.

    A message that fits no schema raises ValueError.
    """

    def __init__(self, file: BinaryIO | None = None) -> None:
        self.times_us = array("q")
        self.topics: list[str] = []
        # Files, by the index of their first message.
        self._files: dict[int, BinaryIO] = {}
        self._places = array("Q")
        self._lengths = array("I")
        self._numbers = array("I")
        self._until: array[int] | None = None
        # Keeps the objects alive whose finalizers close the files.
        self._owners: list[RecordedMessages] = []
        if file is not None:
            self._files[0] = file
            weakref.finalize(self, file.close)

    @classmethod
    def joined(cls, parts: Sequence[tuple[RecordedMessages, int]], end: int | None = None) -> Self:
        """Join the messages of several files in order, each from an index on, before `end`."""
        found = cls()
        found._owners = [each for each, _ in parts]
        for each, begin in parts:
            found._files |= {len(found) + at: file for at, file in each._files.items()}
            found._numbers += each._numbers[begin:end]
            found._lengths += each._lengths[begin:end]
            found._places += each._places[begin:end]
            found.times_us += each.times_us[begin:end]
            found.topics += each.topics[begin:end]
        return found

    def add(self, number: int, topic: str, at_us: int, place: int, length: int) -> None:
        """Index a message of the file."""
        self._numbers.append(number)
        self._lengths.append(length)
        self._places.append(place)
        self.times_us.append(at_us)
        self.topics.append(topic)

    def shifted(self, by_us: int) -> RecordedMessages:
        """Return the same messages, with times later by `by_us`."""
        found = copy(self)
        found._owners = [self]
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
        """Yield the messages of some channels; others are not read."""
        return (self[index] for index, topic in enumerate(self.topics) if topic in topics)

    def check_of(self, number: int) -> str:
        """Return the check of the message with this number; empty if there is none."""
        index = bisect_left(self._numbers, number)
        if index == len(self) or self._numbers[index] != number:
            return ""
        found = _CHECK.search(self._text(index)[-CHECK_LENGTH:])
        return found[1].decode() if found is not None else ""

    def _text(self, index: int) -> bytes:
        index %= len(self)
        begin = max(each for each in self._files if each <= index)
        file = self._files[begin]
        file.seek(self._places[index])
        return file.read(self._lengths[index])

    def valid_before(self, end: int) -> list[int]:
        """Return the indexes of the messages before `end` that are still valid there.

        Validity follows from `Channel.stands_for`. A dropped fact is no longer valid; the start and
        progress of an action are valid until it ends. Raises ValueError for malformed messages.
        """
        if self._until is None:
            try:
                self._until = self._ends()
            except (KeyError, TypeError, RecursionError):
                text = "a message is malformed: a field is missing or of another kind"
                raise ValueError(text) from None
        return [index for index in range(end) if self._until[index] >= end]

    def _ends(self) -> array[int]:
        """Return for each message the index of the message that ends its validity."""
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
    """The content of a recording.

    `cut_off_at` is the byte at which it ends in the middle of a record, or without its end; None if
    it was closed. `torn_bytes` is the number of meaningless bytes after the last whole record, as
    left by a power cut or a full disk. `parts` are the files if the recording has several parts;
    then `records` has no states at the beginnings of later parts, and `metadata` are those of the
    first. `last` is the number and check of the last message. `is_finished`: when it was read, it
    was certain that no process wrote it any more.
    """

    path: Path
    metadata: RunMetadata
    records: RecordedMessages
    damage: tuple[Damage, ...] = ()
    cut_off_at: int | None = None
    signatures: tuple[Signature, ...] = ()
    torn_bytes: int = 0
    last: tuple[int, bytes] = (0, b"")
    parts: tuple[Recording, ...] = ()
    is_finished: bool = True

    @property
    def begin_us(self) -> int:
        """The time of the first message; 0 if there is none."""
        return self.records[0].at_us if self.records else 0

    @property
    def name(self) -> str:
        """Its name where several recordings are compared."""
        return self.path.name

    def name_at(self, number: int) -> str:
        """Return the name of the file that has the message with this number."""
        names = (each.name for each in self.parts if each.metadata.after_number < number)
        return [self.name, *names][-1]

    def has(self, number: int, check: str) -> bool:
        """Return whether it has a message with this number and check.

        The check before the first message is over the metadata.
        """
        if self.parts:
            return any(part.has(number, check) for part in self.parts)
        if number == self.metadata.after_number:
            return first_check(self.metadata.to_values()).hex() == check
        return self.records.check_of(number) == check

    @property
    def begins_late(self) -> str:
        """A note if the first parts of the recording were not kept; else empty."""
        part = self.metadata.part
        if part == 1:
            return ""
        return f"it begins with part {part}: what was before is not kept (--keep), nor proved"

    @property
    def torn(self) -> str:
        """A note about its damaged end; empty if the end is as it was written."""
        if not self.torn_bytes:
            return ""
        lost = f"its last {self.torn_bytes} bytes are no whole record"
        return f"{lost}, as a power cut or a full disk leaves them; it is read up to there"


def read_recording(path: Path) -> Recording:
    """Read the file and check every message.

    The parts that follow it are read as well; a later part given alone is read alone. Raises
    RecordingError if the file is no recording at all.
    """
    return read_recordings(path)[-1]


def open_recording(path: Path) -> Recording:
    """Like `read_recording`, but much faster: messages are validated only when accessed."""
    return read_recordings(path, checks_schemas=False)[-1]


def read_recordings(path: Path, *, checks_schemas: bool = True) -> list[Recording]:
    """Like `read_recording`, but returns several recordings if a part is missing or does not
    follow.

    A new recording begins at such a gap. Returns at least one. Raises RecordingError.
    """
    # A robot that records reads no more than ends of recordings.
    from mrbt_mesh.recording.opened_parts import open_parts

    try:
        files, has_ended = open_parts(path)
    except OSError as error:
        raise _unreadable(Path(error.filename or path), error) from None
    try:
        parts = [*_begun(files, checks_schemas)]
    except RecordingError:
        for _, opened in files:
            opened.close()
        raise
    # The state at the beginning of a part is written in pieces.
    if not has_ended and len(parts) > 1 and not state_end(parts[-1].records):
        parts.pop()
    found: list[list[Recording]] = []
    for each in parts:
        if found and _follows(found[-1][-1], each):
            found[-1].append(each)
        else:
            found.append([each])
    *before, last = map(_joined, found)
    cut_off_at = last.cut_off_at if len(parts) == len(files) else last.cut_off_at or 0
    return [*before, replace(last, cut_off_at=cut_off_at, is_finished=has_ended)]


def _begun(files: Sequence[tuple[Path, BinaryIO]], checks_schemas: bool) -> Iterator[Recording]:
    """Yield the content of files; the last of several may only just have been made."""
    for file, opened in files:
        try:
            yield _read(opened, file, checks_schemas)
        except EmptyRecordingError:
            if len(files) == 1 or file != files[-1][0]:
                raise
        except OSError as error:
            raise _unreadable(file, error) from None


def _unreadable(path: Path, error: OSError) -> RecordingError:
    return RecordingError(f"{path}: cannot be read: {error.strerror or error}")


def _follows(part: Recording, later: Recording) -> bool:
    said = later.metadata
    return (said.part, said.after_number, said.after_check) == (
        part.metadata.part + 1,
        part.last[0],
        part.last[1].hex(),
    )


def _joined(parts: list[Recording]) -> Recording:
    """Return the recording made of these parts."""
    first, last = parts[0], parts[-1]
    if len(parts) == 1:
        return first
    begins = [0, *(state_end(part.records) for part in parts[1:])]
    damage = [each for part in parts for each in part.damage]
    signed = [each for part in parts for each in part.signatures]
    for part, begin in zip(parts[1:], begins[1:], strict=True):
        # A writer that is killed leaves a part that it has only begun.
        if not begin and (part.records or part is not last):
            damage.append(Damage(part.metadata.after_number + 1, "it begins without a state"))
    for part in parts[1:]:
        if any(each.is_end and each.number <= part.metadata.after_number for each in signed):
            text = "a part was added behind its signed end"
            damage.append(Damage(part.metadata.after_number + 1, text))
    rows = [(part.records, begin) for part, begin in zip(parts, begins, strict=True)]
    return replace(
        last,
        path=first_part(first.path),
        metadata=first.metadata,
        records=RecordedMessages.joined(rows),
        damage=tuple(damage),
        signatures=tuple(signed),
        parts=tuple(parts),
    )


def state_end(records: RecordedMessages) -> int:
    """Return the index of the first message after the state at the beginning of a part."""
    return records.topics.index(PARTS) + 1 if PARTS in records.topics else 0


def named(
    files: Iterable[Path], run: str, owners: Collection[str] | None = None
) -> tuple[NamedRecording, ...]:
    """Return how far the recordings with these first parts have been written.

    The first parts themselves may be gone. Recordings of other runs, and empty or unreadable ones,
    are skipped. Only the last messages are read.

    `owners`: the robots that record in these very files, by default all. The file of another one
    may be a copy from its computer, which grows by being copied again.
    """
    found = []
    for path in files:
        parts = parts_of(path)
        # Tested before it is read, so that what nobody writes any more is read to its end.
        has_ended = bool(parts) and is_finished(parts[-1]) and parts_of(path) == parts
        for part in reversed(parts):
            last = _last_message(part, run)
            if last is not None:
                robot, number, check = last
                is_owned = owners is None or robot == OBSERVER or robot in owners
                is_last = has_ended and part == parts[-1] and is_owned
                found.append(NamedRecording(path.name, number, check.hex(), is_last))
                break
    return tuple(found)


def _last_message(path: Path, run: str) -> tuple[str, int, bytes] | None:
    """Return the recording's robot, and number and check of its last message."""
    try:
        reading = _Reading(open_regular(path), checks_schemas=False)
        reading.skip()
    except (OSError, struct.error, ValueError):
        return None
    metadata = reading.metadata or {}
    return (metadata.get("robot", ""), *reading.last) if metadata.get("run") == run else None


def parse_recording(content: bytes, path: Path) -> Recording:
    """Parse a recording from bytes; `path` names it in error messages."""
    return _read(BytesIO(content), path, True)


def _read(file: BinaryIO, path: Path, checks_schemas: bool) -> Recording:
    reading = _Reading(file, checks_schemas)
    end = reading.read()
    has_more = end < reading.size and reading.has_message_behind(end)
    if reading.metadata is None:
        if reading.is_empty:
            text = "it was cut off before its first record"
            raise EmptyRecordingError(f"{path}: holds nothing: {text}")
        what = reading.problem or "it holds no metadata of mrbt"
        raise RecordingError(f"{path} is not an mrbt recording: {what}")
    try:
        metadata = RunMetadata.from_values(reading.metadata)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    try:
        _ = metadata.team_digest
    except FileError:
        raise RecordingError(f"{path}: the mission in its metadata is damaged") from None
    if metadata.to_values() != reading.metadata:
        reading.damage.insert(0, Damage(0, "its metadata are not those that mrbt writes"))
    cut_off = None if reading.is_closed else end
    if has_more:
        # A file cut off by the end of its writer has no whole message after the cut.
        reading.note_damage_at(end)
        cut_off = None
    damage, signatures = tuple(reading.damage), tuple(reading.signatures)
    torn = 0 if has_more else reading.size - end
    records, last = reading.records, reading.last
    return Recording(path, metadata, records, damage, cut_off, signatures, torn, last)


class _Reading:
    """One pass through a file, message by message.

    `size` is its length in bytes. `is_empty`: it was begun as a recording, and has no metadata yet.
    """

    def __init__(self, file: BinaryIO, checks_schemas: bool) -> None:
        self.metadata: dict[str, str] | None = None
        self.records = RecordedMessages(file)
        self.signatures: list[Signature] = []
        self.damage: list[Damage] = []
        self.is_closed = False
        self.is_empty = False
        self.problem = ""
        self.size = file.seek(0, SEEK_END)
        self._file = file
        self._checks_schemas = checks_schemas
        self._topics = tuple(CHANNELS)
        self._of_channel: dict[int, str] = {}
        self._check = b""
        self._number = 0
        self._epoch_ns = 0
        # True once a signature says that the recording ends with it.
        self._has_ended = False
        # After this byte there are only zeros.
        self._solid = self._end_of_data()

    @property
    def last(self) -> tuple[int, bytes]:
        """Number and check of the last message."""
        return self._number, self._check

    def _end_of_data(self) -> int:
        end = self.size
        while end:
            begin = max(0, end - READ_BYTES)
            self._file.seek(begin)
            found = self._file.read(end - begin).rstrip(b"\0")
            if found:
                return begin + len(found)
            end = begin
        return 0

    def read(self) -> int:
        """Read as far as possible; return the first byte that was not understood."""
        end = self._begin()
        if self.metadata is None:
            return end
        try:
            while not self.is_closed and (begin := end + mcap_file.FRAME.size) <= self._solid:
                self._file.seek(end)
                opcode, length = mcap_file.FRAME.unpack(self._file.read(mcap_file.FRAME.size))
                if opcode == mcap_file.DATA_END:
                    return self._end(end)
                # No message ends with a zero: one that reaches into them is torn.
                if begin + length > self._solid:
                    break
                self._record(opcode, end, length)
                end = begin + length
        except (struct.error, ValueError, OverflowError, MemoryError) as error:
            self.problem = str(error) or type(error).__name__
        rest = self._until_zeros(end)
        if not self._is_torn_message(rest) and not mcap_file.end(self._topics, end).startswith(
            rest
        ):
            self.note_damage_at(end)
        return end

    def skip(self) -> None:
        """Go to the last whole message without reading those before it."""
        begin, frame, last = self._begin(), mcap_file.FRAME, (0, 0)
        while self.metadata is not None and begin + frame.size <= self._solid:
            self._file.seek(begin)
            opcode, length = frame.unpack(self._file.read(frame.size))
            end = begin + frame.size + length
            if opcode != mcap_file.MESSAGE or end > self._solid:
                break
            last, begin = (begin + frame.size, length), end
        if last[1]:
            self._file.seek(last[0])
            content = self._file.read(last[1])
            found = _CHECK.search(content[-CHECK_LENGTH:])
            if found is not None:
                self._number = mcap_file.MESSAGE_FIELDS.unpack_from(content)[1]
                self._check = bytes.fromhex(found[1].decode())

    def note_damage_at(self, place: int) -> None:
        """Note that nothing is understood from this byte on, although more was written."""
        found = Damage(self._number + 1, f"the file is damaged at byte {place}")
        if found not in self.damage:
            self.damage.append(found)

    def _is_torn_message(self, found: bytes) -> bool:
        """Return whether this may be an incomplete next message."""
        frame, fields = mcap_file.FRAME.size, mcap_file.MESSAGE_FIELDS
        if found[:1] not in (b"", bytes([mcap_file.MESSAGE])):
            return False
        content = found[frame : frame + fields.size]
        if len(content) < fields.size:
            return True
        channel, number, log_ns, publish_ns = fields.unpack(content)
        text = found[frame + fields.size :].rstrip(b"\0")
        fits = channel in self._of_channel and number == self._number + 1 and log_ns == publish_ns
        return fits and text.isascii() and text.decode().isprintable()

    def _begin(self) -> int:
        """Read what precedes the messages, which follows from the metadata; return its end."""
        file, frame, end = self._file, mcap_file.FRAME, len(mcap_file.MAGIC)
        file.seek(0)
        is_mcap = file.read(end) == mcap_file.MAGIC
        if not is_mcap:
            self.problem = "not a valid MCAP file"
        while is_mcap and self.metadata is None and end + frame.size <= self._solid:
            file.seek(end)
            opcode, length = frame.unpack(file.read(frame.size))
            if end + frame.size + length > self._solid:
                break
            if opcode == mcap_file.METADATA_RECORD:
                with contextlib.suppress(ValueError):
                    name, values = mcap_file.read_metadata(file.read(length))
                    if name == mcap_file.METADATA:
                        self.metadata = values
            end += frame.size + length
        file.seek(0)
        content = file.read(end)
        if self.metadata is None:
            self.is_empty = self._is_begun()
            return 0
        if CHANNELS[BEATS].name.encode() not in content:
            self._topics = tuple(topic for topic in CHANNELS if topic != BEATS)
        numbers = mcap_file.channel_numbers(self._topics)
        self._of_channel = {number: topic for topic, number in numbers.items()}
        if content != mcap_file.begin(self._topics, self.metadata):
            self._say(0, "it does not begin as recordings of mrbt do: other records, or changed")
        self._check = first_check(self.metadata)
        with contextlib.suppress(ValueError):
            self._epoch_ns = int(self.metadata.get("epoch_ns", ""))
            self._number = int(self.metadata.get("after_number", ""))
        return end

    def _is_begun(self) -> bool:
        """Return whether this may be the beginning of a recording, followed only by zeros."""
        self._file.seek(0)
        content = self._file.read(self._solid)
        known = mcap_file.before_metadata(tuple(CHANNELS))
        shorter = mcap_file.before_metadata(tuple(t for t in CHANNELS if t != BEATS))
        return any(
            each.startswith(content)
            or (content.startswith(each) and content[len(each)] == mcap_file.METADATA_RECORD)
            for each in (known, shorter)
        )

    def _end(self, place: int) -> int:
        """Read the end of a closed recording; return its first byte if it is torn."""
        wanted = mcap_file.end(self._topics, place)
        self._file.seek(place)
        found = self._file.read(len(wanted) + 1)
        if found[: len(wanted)] == wanted:
            self.is_closed = True
            end = place + len(wanted)
            if end < self._solid:
                self._say(self._number, f"something follows its end, from byte {end} on")
            return end
        written = self._until_zeros(place)
        if not wanted.startswith(written):
            self._say(self._number, f"its end, from byte {place} on, was changed")
        return place

    def _until_zeros(self, place: int) -> bytes:
        self._file.seek(place)
        return self._file.read(max(0, self._solid - place))

    def has_message_behind(self, place: int) -> bool:
        """Return whether a message's check follows this byte."""
        self._file.seek(place)
        before = b""
        # The file may have grown since.
        while block := self._file.read(min(READ_BYTES, self.size - self._file.tell())):
            if _CHECK.search(before + block) is not None:
                return True
            before = block[-CHECK_LENGTH:]
        return False

    def _record(self, opcode: int, place: int, length: int) -> None:
        """Read one MCAP record. Only messages are allowed between the beginning and the end."""
        if opcode == mcap_file.MESSAGE:
            self._message(self._file.read(length), place + mcap_file.FRAME.size)
            return
        what = mcap_file.NAMES.get(opcode, f"unknown, {opcode}")
        text = f"a record of another kind ({what}) stands at byte {place}: mrbt writes none there"
        self._say(self._number + 1, text)

    def _message(self, content: bytes, place: int) -> None:
        channel, number, log_ns, publish_ns = mcap_file.MESSAGE_FIELDS.unpack_from(content)
        topic = self._of_channel.get(channel, "")
        data = content[mcap_file.MESSAGE_FIELDS.size :]
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
        if self._has_ended:
            self._say(number, f"a message on {topic} was added behind its signed end")
        try:
            if topic not in CHANNELS:
                raise ValueError("there is no such channel")
            if self._checks_schemas or topic == SIGNATURES:
                message = _read_message(topic, data)
                if to_json(message).encode() != body:
                    raise ValueError("its text is not as mrbt writes it")
                if topic == SIGNATURES:
                    self._signature(message, number, check, log_ns)
        except (ValueError, RecursionError) as error:
            self._say(number, f"no message of {topic or 'a known channel'}: {error}")
            return
        at_us = (log_ns - self._epoch_ns) // 1_000
        self.records.add(number, topic, at_us, place + mcap_file.MESSAGE_FIELDS.size, len(data))

    def _signature(self, content: Mapping[str, Any], number: int, check: bytes, at_ns: int) -> None:
        """Add a signature. Raises ValueError."""
        by, is_end, signature = content["by"], content["end"], read_bytes(content["signature"])
        times_us = self.records.times_us
        # The first signature covers no message: it proves when it was made.
        until_us = times_us[-1] if times_us else (at_ns - self._epoch_ns) // 1_000
        self._has_ended |= is_end
        wanted = signed_content(number - 1, check, is_end, at_ns)
        self.signatures.append(Signature(number, by, until_us, is_end, check, wanted, signature))

    def _say(self, number: int, text: str) -> None:
        self.damage.append(Damage(number, text))


def _read_message(topic: str, text: bytes) -> Mapping[str, Any]:
    """Return a message without its check. Raises ValueError if it does not fit the schema."""
    try:
        content = json.loads(text)
        _validator(topic)(content)
    except RecursionError as error:
        raise ValueError(str(error)) from None
    del content["check"]
    return dict(content)


@cache
def _validator(topic: str) -> Callable[[Any], Any]:
    """Return a function that raises ValueError for a message that does not fit the channel's
    schema.
    """
    made: Callable[[Any], Any] = fastjsonschema.compile(dict(CHANNELS[topic].schema))
    return made
