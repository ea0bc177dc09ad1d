"""What is no recording is refused with a message; nothing that is read can end the reader."""

from __future__ import annotations

import contextlib
import json
import math
import os
import struct
from dataclasses import asdict
from pathlib import Path
from typing import BinaryIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.recording import writer
from mrbt_mesh.recording.folder import open_part
from mrbt_mesh.recording.mcap_file import MAGIC
from mrbt_mesh.recording.metadata import RunMetadata, pack_named, parse_named
from mrbt_mesh.recording.reader import RecordingError, named, parse_recording, read_recording
from mrbt_mesh.recording.writer import RecordingWriter
from tests.support.build import action, make_mission, task

MISSION = make_mission(action("a1"), {"A": {"t": 1}}, [task("a1", ("t", 1, 1))])


@pytest.fixture(scope="session")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A recording of one message."""
    path = tmp_path_factory.mktemp("reader") / "a.mcap"
    recording = RecordingWriter(path, RunMetadata.of(MISSION, "A", "r1", Timing(), 0, "1"))
    recording.write("/alive", 1, {"robots": {"A": "1.x"}})
    recording.close()
    return path.read_bytes()


def test_a_file_that_is_none(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_text("no recording")
    with pytest.raises(RecordingError, match=r"other is not an mrbt recording: not a valid MCAP"):
        read_recording(other)
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        read_recording(tmp_path / "missing")


@pytest.mark.parametrize("text", [b"n", b"no", b"no recording of anything"])
def test_text_is_no_recording(text: bytes) -> None:
    with pytest.raises(RecordingError, match="x is not an mrbt recording: not a valid MCAP file"):
        parse_recording(text, Path("x"))


@pytest.mark.parametrize("compression", [b"zstd", b"lz4", b""])
def test_chunks_are_not_unpacked(compression: bytes) -> None:
    said = struct.pack("<QQQII", 0, 0, 100, 0, len(compression)) + compression
    chunk = said + struct.pack("<Q", 5) + b"junk!"
    content = MAGIC + struct.pack("<BQ", 0x06, len(chunk)) + chunk
    with pytest.raises(RecordingError, match="x is not an mrbt recording"):
        parse_recording(content, Path("x"))


@pytest.mark.parametrize(
    ("field", "text"),
    [
        ("epoch_ns", "9" * 5000),
        ("epoch_ns", "soon"),
        ("timing", "[" * 100_000),
        ("timing", json.dumps(dict.fromkeys(asdict(Timing()), math.inf))),
        ("timing", "[]"),
        ("speed", "nan"),
        ("speed", "-1"),
        ("has_keys", "perhaps"),
    ],
)
def test_metadata_that_say_something_strange(tmp_path: Path, field: str, text: str) -> None:
    class Strange(RunMetadata):
        def to_values(self) -> dict[str, str]:
            return {**super().to_values(), field: text}

    path = tmp_path / "a.mcap"
    plain = vars(RunMetadata.of(MISSION, "A", "r1", Timing(), 0, "1"))
    RecordingWriter(path, Strange(**plain)).close()
    with pytest.raises(RecordingError, match=r"a\.mcap: "):
        read_recording(path)


def test_another_format_is_refused(content: bytes) -> None:
    changed = content.replace(
        b"\x06\x00\x00\x00format\x01\x00\x00\x006", b"\x06\x00\x00\x00format\x01\x00\x00\x009"
    )
    assert changed != content
    with pytest.raises(RecordingError, match="its format is 9, this version of mrbt reads 6"):
        parse_recording(changed, Path("x"))


def test_a_schema_that_was_changed_is_told(content: bytes) -> None:
    changed = content.replace(b'"title": "mrbt.Alive"', b'"title": "mrbt.Alife"', 1)
    (damage,) = parse_recording(changed, Path("x")).damage
    assert "it does not begin as recordings" in damage.text


@given(at=st.integers(0), bits=st.integers(1, 255))
def test_no_byte_ends_the_reader(content: bytes, at: int, bits: int) -> None:
    changed = bytearray(content)
    changed[at % len(changed)] ^= bits
    with contextlib.suppress(RecordingError):
        assert len(parse_recording(bytes(changed), Path("x")).records) <= 1


@given(st.binary(max_size=200))
def test_no_bytes_behind_a_recording_end_the_reader(content: bytes, more: bytes) -> None:
    cut = content[: content.rindex(b',"check":"')]
    assert len(parse_recording(cut + more, Path("x")).records) <= 1


@pytest.mark.parametrize("wrong", [b'["compiled"', b"[1,        ", b"[]"])
def test_a_mission_that_is_damaged_is_damage_of_the_metadata(content: bytes, wrong: bytes) -> None:
    changed = content.replace(b'{"compiled"', wrong.ljust(11), 1)
    with pytest.raises(RecordingError, match="x: "):
        parse_recording(changed, Path("x"))


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="there is no such file here")
def test_a_file_that_cannot_be_read_is_named() -> None:
    with pytest.raises(RecordingError, match="/proc/self/mem: cannot be read: Invalid argument"):
        read_recording(Path("/proc/self/mem"))


@pytest.mark.timeout(20)
def test_a_pipe_is_refused_and_nobody_is_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match="it is not a regular file"):
        read_recording(tmp_path / "a.mcap")
    assert named([tmp_path / "a.mcap"], "r1") == ()


def test_a_recording_is_finished_when_nobody_writes_it_any_more(tmp_path: Path) -> None:
    path, metadata = tmp_path / "a.mcap", RunMetadata.of(MISSION, "A", "r1", Timing(), 0, "1")
    recording = RecordingWriter(path, metadata)
    recording.write("/alive", 1, {"robots": {"A": "1.x"}})
    recording.flush(1)
    (goes_on,) = named([path], "r1")
    assert (goes_on.number, goes_on.is_finished) == (1, False)
    recording.abandon()
    (ended,) = named([path], "r1")
    assert ended == goes_on._replace(is_finished=True)
    assert named([path], "r1", owners=["A"]) == (ended,)
    assert named([path], "r1", owners=["B"]) == (goes_on,), "it may be a copy"
    assert parse_named(pack_named([ended, goes_on])) == (ended, goes_on)


def test_a_recording_goes_on_while_another_part_of_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, metadata = tmp_path / "a.mcap", RunMetadata.of(MISSION, "A", "r1", Timing(), 0, "1")
    recording = RecordingWriter(path, metadata, 1 << 20)
    recording.write("/alive", 1, {"robots": {"A": "1.x"}})
    seen = []

    def opened(part: Path) -> BinaryIO:
        seen.extend(named([path], "r1"))
        found = open_part(part)
        seen.extend(named([path], "r1"))
        return found

    monkeypatch.setattr(writer, "open_part", opened)
    recording.begin_part(MISSION, (), {"incarnation": "", "sequence": 0, "ticket": 0}, 2)
    assert [each.is_finished for each in (*seen, *named([path], "r1"))] == [False] * 3
    recording.close()
    assert named([path], "r1")[0].is_finished
