"""What is written is read again: as it was, by other readers of MCAP, and from a file cut short."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader

from mrbt_mesh.core.facts.store import BatchProof, Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.recording.channels import BEATS, CHANNELS, DROPPED, FACTS, LIFE
from mrbt_mesh.recording.mcap_file import METADATA
from mrbt_mesh.recording.messages import pack_fact, unpack_fact
from mrbt_mesh.recording.metadata import RunMetadata
from mrbt_mesh.recording.reader import parse_recording, read_recording
from mrbt_mesh.recording.writer import RecordingWriter
from tests.support.build import action, make_mission, task
from tests.support.plain_data import plain

MISSION = make_mission(action("a1"), {"A": {"t": 1}}, [task("a1", ("t", 1, 1))])
METADATA_OF_A = RunMetadata.of(MISSION, "A", "r1", Timing(), 7_000_000, "1.0")

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
versions = st.builds(
    Version, st.builds(Incarnation, st.integers(0, 1 << 60), texts), st.integers(0, 1 << 60)
)
proofs = st.none() | st.builds(BatchProof, st.binary(max_size=40), st.binary(max_size=64))
facts = st.builds(
    lambda author, version, success, data, proof: parse_entry(
        author, "outcome/r1:0:a1::0/t", version, [success, data], proof
    ),
    texts,
    versions,
    st.booleans(),
    plain,
    proofs,
)


def writer(path: Path) -> RecordingWriter:
    """A writer of a new file in place of an old one."""
    path.unlink(missing_ok=True)
    return RecordingWriter(path, METADATA_OF_A)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(facts, st.integers(0, 1 << 50)), max_size=8), st.booleans())
def test_facts_come_back_to_the_byte(
    tmp_path: Path, rows: list[tuple[Entry, int]], is_closed: bool
) -> None:
    path = tmp_path / "a.mcap"
    recording = writer(path)
    for number, (entry, at_us) in enumerate(rows, start=1):
        recording.write(FACTS, at_us, pack_fact(entry, number))
    recording.flush(0)
    if is_closed:
        recording.close()
    found = read_recording(path)
    assert (found.damage, found.metadata) == ((), METADATA_OF_A)
    assert (found.cut_off_at is None) is is_closed
    assert [each.at_us for each in found.records] == [at_us for _, at_us in rows]
    for record, (entry, _) in zip(found.records, rows, strict=True):
        again = unpack_fact(record.data)
        assert (again, again.packed, again.hash) == (entry, entry.packed, entry.hash)
        assert again.proof == entry.proof
    if not is_closed:
        recording.close()


@pytest.fixture
def three(tmp_path: Path) -> bytes:
    """A recording of three messages whose writer was killed."""
    path = tmp_path / "three.mcap"
    recording = writer(path)
    for number in (1, 2, 3):
        data = {"number": number, "author": "A", "name": f"condition/c{number}"}
        recording.write(DROPPED, number, data)
        recording.flush(0)
    content = path.read_bytes()
    recording.close()
    return content


def test_a_file_that_ends_anywhere_is_read_up_to_there(three: bytes) -> None:
    """At every byte of the last two messages, and of what stands before the first."""
    whole = parse_recording(three, Path("x"))
    assert [each.data["number"] for each in whole.records] == [1, 2, 3]
    sizes = [len(part) for part in three.split(b'"check"')]
    second = len(three) - sizes[-1] - sizes[-2] - len(b'"check"')
    seen = set()
    for end in range(second, len(three)):
        found = parse_recording(three[:end], Path("x"))
        assert found.damage == (), end
        assert found.cut_off_at is not None
        assert found.cut_off_at <= end
        assert found.records[:] == whole.records[: len(found.records)]
        seen.add(len(found.records))
    assert seen == {1, 2}


def test_no_byte_of_a_message_can_be_changed_unseen(three: bytes) -> None:
    begin = three.index(b'{"number":1') - 31
    for at in range(begin, len(three)):
        changed = bytearray(three)
        changed[at] ^= 0x41
        found = parse_recording(bytes(changed), Path("x"))
        missing = len(found.records) < 3 and found.cut_off_at is not None
        assert found.damage or (missing and at > three.rindex(b'"check"') - 120), at


def test_a_message_that_was_taken_out_is_missed(three: bytes) -> None:
    start = three.index(b'{"number":2') - 31
    end = three.index(b'{"number":3') - 31
    found = parse_recording(three[:start] + three[end:], Path("x"))
    assert found.damage[0].number == 2
    assert "it is missing" in found.damage[0].text


def test_other_readers_of_mcap_read_it(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recording = writer(path)
    said = CHANNELS[LIFE].example
    recording.write(LIFE, 5_000, said)
    recording.flush(0)
    with path.open("rb") as stream:  # not closed yet, so not ended
        messages = NonSeekingReader(stream).iter_messages(log_time_order=False)
        schema, channel, message = next(messages)
        assert schema is not None
        assert (schema.name, schema.encoding, channel.topic) == ("mrbt.Life", "jsonschema", LIFE)
        assert message.log_time == 7_000_000 + 5_000_000
    recording.close()
    with path.open("rb") as stream:
        reader = make_reader(stream)
        (found,) = [json.loads(message.data) for _, _, message in reader.iter_messages()]
        assert {key: value for key, value in found.items() if key != "check"} == said
        summary = reader.get_summary()
        assert summary is not None
        assert {channel.topic for channel in summary.channels.values()} == set(CHANNELS) - {BEATS}
    with path.open("rb") as stream:
        (metadata,) = NonSeekingReader(stream).iter_metadata()
    assert (metadata.name, metadata.metadata["robot"]) == (METADATA, "A")


def test_a_file_that_is_there_stays(tmp_path: Path) -> None:
    for _ in range(3):
        RecordingWriter(tmp_path / "a.mcap", METADATA_OF_A).close()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["a.2.mcap", "a.3.mcap", "a.mcap"]
