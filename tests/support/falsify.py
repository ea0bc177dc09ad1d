"""Falsifies recordings at random: one byte, or one value with all checks made anew."""

from __future__ import annotations

import copy
import random
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mrbt_mesh.core.facts.store import Entry, parse_entry
from mrbt_mesh.recording.channels import FACTS, PLANS
from mrbt_mesh.recording.messages import pack_fact, unpack_fact
from mrbt_mesh.recording.reader import RecordedMessage, Recording, parse_recording
from mrbt_mesh.recording.writer import RecordingWriter


@dataclass(frozen=True)
class Falsified:
    """A recording that is not as it was: which record, and what was done to it."""

    recording: Recording = field(repr=False)
    record: int
    how: str


def falsify(recording: Recording, folder: Path, seed: int) -> Falsified | None:
    """Change one fact, plan or claim; None where the draw hits nothing that can be changed so."""
    draw = random.Random(seed)
    wanted = draw.choice((FACTS, PLANS, "claim"))
    records = [each for each in recording.records if _fits(each, wanted)]
    if not records:
        return None
    record = draw.choice(records)
    how = draw.choice((_byte, _value, _forged))
    return how(recording, record, folder, draw)


def _fits(record: RecordedMessage, wanted: str) -> bool:
    if wanted == "claim":
        return record.topic == FACTS and record.data["name"] == "claim"
    return record.topic == wanted


def _byte(
    recording: Recording, record: RecordedMessage, folder: Path, draw: random.Random
) -> Falsified | None:
    """Another byte at any place of the message in the file, its frame included."""
    content = bytearray(recording.path.read_bytes())
    begin, end = place_of(content, record.number)
    at = draw.randrange(begin, end)
    content[at] ^= draw.randrange(1, 256)
    changed = parse_recording(bytes(content), recording.path)
    return Falsified(changed, record.number, f"byte {at - begin} of {end - begin}")


def place_of(content: bytes | bytearray, number: int) -> tuple[int, int]:
    """Where in a file the message of this number is: opcode, length, header and data."""
    at, found = 8, 0
    while True:
        length = int.from_bytes(content[at + 1 : at + 9], "little")
        found += content[at] == 0x05  # a message
        if found == number:
            return at, at + 9 + length
        at += 9 + length


def _value(
    recording: Recording, record: RecordedMessage, folder: Path, draw: random.Random
) -> Falsified | None:
    """Another value in one field, or another key, and all checks of the file made anew."""
    data = copy.deepcopy(dict(record.data))
    leaves = list(_leaves(data, ()))
    path = draw.choice(leaves)
    holder: Any = data
    for step in path[:-1]:
        holder = holder[step]
    holder[path[-1]] = _other(holder[path[-1]], draw)
    return _resealed(recording, record, data, folder, f"the value of {path}")


def _forged(
    recording: Recording, record: RecordedMessage, folder: Path, draw: random.Random
) -> Falsified | None:
    """A fact that says something else, with its packed value and its hash made to fit."""
    if record.topic != FACTS:
        return _value(recording, record, folder, draw)
    entry = unpack_fact(record.data)
    for _ in range(50):
        forged = _another(entry, draw)
        if forged is not None and forged.hash != entry.hash:
            data = pack_fact(forged, record.data["number"])
            how = f"{entry.name} forged: {forged.version} {forged.value}"
            return _resealed(recording, record, data, folder, how)
    return None


def _another(entry: Entry, draw: random.Random) -> Entry | None:
    value, version = copy.deepcopy(entry.value), entry.version
    leaves = list(_leaves([value], ()))
    if draw.random() < 0.2 or not leaves:
        version = replace_sequence(entry, draw)
    else:
        holder: Any = [value]
        path = draw.choice(leaves)
        for step in path[:-1]:
            holder = holder[step]
        holder[path[-1]] = _other(holder[path[-1]], draw)
        value = holder[0] if len(path) == 1 else value
    try:
        return parse_entry(entry.author, entry.name, version, value, entry.proof)
    except ValueError:
        return None


def replace_sequence(entry: Entry, draw: random.Random) -> Any:
    """The version of another batch."""
    return entry.version._replace(sequence=entry.version.sequence + draw.choice((1, 2, 1_000)))


def _leaves(data: Any, path: tuple[Any, ...]) -> list[tuple[Any, ...]]:
    """The paths of all values that hold no others."""
    items = data.items() if isinstance(data, Mapping) else enumerate(data)
    found: list[tuple[Any, ...]] = []
    for key, value in items:
        inner = isinstance(value, Mapping | list)
        found += _leaves(value, (*path, key)) if inner and value else [(*path, key)]
    return found


def _other(value: Any, draw: random.Random) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + draw.choice((-1, 1, 7)) if value else 1
    if isinstance(value, float):
        return value + 0.5
    if isinstance(value, str) and value:
        at = draw.randrange(len(value))
        letters = [each for each in "0a1bF." if each != value[at]]
        return value[:at] + draw.choice(letters) + value[at + 1 :]
    return "x"


def _resealed(
    recording: Recording, record: RecordedMessage, data: Mapping[str, Any], folder: Path, how: str
) -> Falsified:
    path = folder / recording.name
    path.unlink(missing_ok=True)
    changed = [
        replace(each, data=data) if each.number == record.number else each
        for each in recording.records
    ]
    write_again(replace(recording, records=tuple(changed)), path)
    return Falsified(parse_recording(path.read_bytes(), path), record.number, how)


def write_again(recording: Recording, path: Path) -> None:
    """The same messages in a file of its own, which a check finds nothing wrong with."""
    writer = RecordingWriter(path, recording.metadata, beats=True)
    for record in recording.records:
        writer.write(record.topic, record.at_us, record.data)
    writer.close()
