"""Damage at the end of a recording is an accident, and is read up to there; anything else in a file
that its writer did not write so is named.
"""

from __future__ import annotations

import itertools
import random
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.recording import mcap_file
from mrbt_mesh.recording.channels import CHANNELS, DROPPED, POSITIONS, SIGNATURES
from mrbt_mesh.recording.messages import MessageEncoder
from mrbt_mesh.recording.metadata import RunMetadata
from mrbt_mesh.recording.reader import (
    EmptyRecordingError,
    Recording,
    RecordingError,
    parse_recording,
)
from mrbt_mesh.recording.writer import RecordingWriter
from tests.support.build import action, make_mission, task
from tests.support.keys import keys_of

MISSION = make_mission(action("a1"), {"A": {"t": 1}}, [task("a1", ("t", 1, 1))])
BEGUN = RunMetadata.of(MISSION, "A", "r1", Timing(), 1_700_000_000_000_000_000, "1.0")
PATH = Path("a.mcap")
COUNT = 6
# What a file system leaves of what was not written: nothing, less than a block, a block, more.
TAILS = (0, 1, 7, 512, 8_192, 70_000)


@pytest.fixture(scope="module", params=["closed", "killed"])
def content(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A signed recording, of a writer that closed it or was killed."""
    path = tmp_path_factory.mktemp("damage") / "a.mcap"
    recording = RecordingWriter(path, BEGUN, keys=keys_of("A")["A"])
    for number in range(1, COUNT):
        data = {"number": number, "author": "A", "name": f"condition/c{number}"}
        recording.write(DROPPED, number * 400_000, data)
        recording.flush(number * 400_000)
    if request.param == "closed":
        recording.close()
    content = path.read_bytes()
    recording.abandon()
    return content


def parsed(content: bytes) -> Recording:
    return parse_recording(content, PATH)


def first_message(content: bytes) -> int:
    """Where the messages begin."""
    metadata = parsed(content).metadata.to_values()
    return len(mcap_file.begin(tuple(t for t in CHANNELS if t != "/beats"), metadata))


def test_every_cut_with_any_tail_of_zeros_is_read_up_to_there(content: bytes) -> None:
    whole = parsed(content)
    assert whole.damage == ()
    assert not whole.torn
    begin = first_message(content)
    ends = _ends(content, begin)
    for cut in _places(content, begin):
        for zeros in TAILS:
            found = parsed(content[:cut] + bytes(zeros))
            assert found.damage == (), (cut, zeros)
            assert found.records[:] == whole.records[: len(found.records)], (cut, zeros)
            # What was written whole is there.
            kept = sum(end <= cut for end in ends)
            assert len(found.records) == kept, (cut, zeros)
            assert bool(found.torn) is (found.torn_bytes > 0)
            assert found.cut_off_at is not None
            assert found.torn_bytes == cut + zeros - found.cut_off_at


def _places(content: bytes, begin: int) -> list[int]:
    """Some bytes of messages, and of what follows them; from a message's begin to its text all."""
    end = _ends(content, begin)[-1]
    some = random.Random(0).sample(range(end, len(content)), 40) if end < len(content) else []
    return [*range(begin, begin + 60), *range(end - 40, min(end + 30, len(content))), *some]


def _ends(content: bytes, begin: int) -> list[int]:
    """Where messages end in the file."""
    found, at = [], begin
    while at + 9 <= len(content) and content[at] == mcap_file.MESSAGE:
        at += 9 + int.from_bytes(content[at + 1 : at + 9], "little")
        found.append(at)
    return found


def test_a_file_cut_off_before_its_first_record_is_empty(content: bytes) -> None:
    begin = first_message(content)
    for cut in random.Random(1).sample(range(begin), 40):
        for zeros in TAILS:
            with pytest.raises(EmptyRecordingError, match="cut off before its first record"):
                parsed(content[:cut] + bytes(zeros))


@pytest.mark.parametrize("ends_again", [False, True])
def test_nothing_follows_a_signed_end(tmp_path: Path, ends_again: bool) -> None:
    """Whatever is added there, torn or closed, the checks may be right and the time the same."""
    path, keys = tmp_path / "a.mcap", keys_of("A")["A"]
    recording, encoder = RecordingWriter(path, BEGUN), MessageEncoder(BEGUN)
    dropped = {"number": 1, "author": "A", "name": "condition/c"}
    for topic in (DROPPED, SIGNATURES, DROPPED, SIGNATURES)[: 4 if ends_again else 3]:
        data = dropped if topic == DROPPED else encoder.sign(keys, True, 0)
        encoder.encode(topic, 0, data)
        recording.write(topic, 0, data)
    recording.close()
    texts = [(each.number, each.text) for each in parsed(path.read_bytes()).damage]
    assert texts[0] == (3, "a message on /dropped was added behind its signed end")


def test_a_signature_over_nothing_proves_its_own_time(tmp_path: Path) -> None:
    """The clock of a robot counts from the start of its computer."""
    path, up_us = tmp_path / "a.mcap", 15_982_000_000
    recording = RecordingWriter(path, BEGUN, keys=keys_of("A")["A"])
    recording.flush(up_us)
    recording.abandon()
    assert [each.until_us for each in parsed(path.read_bytes()).signatures] == [up_us]


def test_zeros_alone_are_an_empty_recording() -> None:
    with pytest.raises(EmptyRecordingError):
        parsed(bytes(4_096))


def test_zeros_behind_the_end_are_an_accident(content: bytes) -> None:
    found = parsed(content + bytes(512))
    assert found.damage == ()
    assert "its last 512 bytes are no whole record" in found.torn


def test_zeros_within_are_a_change(content: bytes) -> None:
    begin = first_message(content)
    ends = [begin, *_ends(content, begin)]
    for at, end in itertools.pairwise(ends[:-1]):
        changed = content[:at] + bytes(end - at) + content[end:]
        assert parsed(changed).damage, at


CHUNK = struct.pack("<QQQII", 0, 0, 100, 0, 0) + struct.pack("<Q", 5) + b"junk!"
OTHERS = {
    "Chunk": (6, CHUNK),
    "Attachment": (9, bytes(60)),
    "Metadata": (12, b"\5\0\0\0other\0\0\0\0"),
    "second mrbt metadata": (12, b"\4\0\0\0mrbt\0\0\0\0"),
    "Header": (1, bytes(8)),
    "Schema": (3, struct.pack("<H", 99) + bytes(12)),
    "Channel": (4, struct.pack("<HH", 99, 1) + bytes(12)),
    "Statistics": (11, bytes(46)),
    "Index": (7, bytes(6)),
    "opcode of a private record": (0x81, b"anything"),
    "opcode of zero": (0, b"anything"),
    "Footer": (2, bytes(20)),
}


@pytest.mark.parametrize("what", sorted(OTHERS))
def test_records_that_mrbt_does_not_write_are_named(content: bytes, what: str) -> None:
    """At each place between messages, behind the metadata, before them, and behind the end."""
    opcode, body = OTHERS[what]
    record = struct.pack("<BQ", opcode, len(body)) + body
    begin = first_message(content)
    places = [len(mcap_file.MAGIC), begin, *_ends(content, begin), len(content)]
    for place in places:
        try:
            found = parsed(content[:place] + record + content[place:])
        except RecordingError as error:
            assert not isinstance(error, EmptyRecordingError)  # noqa: PT017
            continue
        assert found.damage, (what, place)


def test_no_byte_of_a_closed_recording_can_be_changed_unseen(content: bytes) -> None:
    """Of its beginning and end as well; nothing is left out, and nothing can be put in."""
    whole = parsed(content)
    begin = first_message(content)
    end = _ends(content, begin)[-1]
    elsewhere = random.Random(0).sample([*range(begin), *range(end, len(content))], 200)
    for at in [*range(begin, begin + 200), *range(end - 200, end), *elsewhere]:
        changed = bytearray(content)
        changed[at] ^= 0x15
        try:
            found = parsed(bytes(changed))
        except RecordingError:
            continue
        is_shorter = found.cut_off_at is not None and len(found.records) < len(whole.records)
        lost_its_end = found.cut_off_at is not None and whole.cut_off_at is None
        assert found.damage or is_shorter or lost_its_end, at


@given(st.data())
def test_a_message_in_another_text_is_named(data: st.DataObject) -> None:
    """The same values, written as another JSON text, with all checks made anew."""
    body = data.draw(
        st.sampled_from(
            [
                b'{"number": 1,"author":"A","name":"c"}',
                b'{"number":1,"author":"B","author":"A","name":"c"}',
                b'{"author":"A","number":1,"name":"c" }',
                b'{"number":1e0,"author":"A","name":"c"}',
                b'{"number":1,"author":"\\u0041","name":"c"}',
            ]
        )
    )
    found = parsed(_resealed(body))
    assert [each.number for each in found.damage] == [1]
    assert "not as mrbt writes it" in found.damage[0].text or "must be" in found.damage[0].text


def _resealed(body: bytes) -> bytes:
    """A recording with this one message, and its check."""
    from mrbt_mesh.recording.messages import first_check, next_check

    values = BEGUN.to_values()
    topics = tuple(topic for topic in CHANNELS if topic != "/beats")
    at_ns = BEGUN.epoch_ns
    check = next_check(first_check(values), 1, DROPPED, at_ns, body).hex().encode()
    text = b'%s,"check":"%s"}' % (body[:-1], check)
    channel = mcap_file.channel_numbers(topics)[DROPPED]
    return mcap_file.begin(topics, values) + mcap_file.message(channel, 1, at_ns, text)


def test_positions_on_a_channel_of_another_program_are_named(content: bytes) -> None:
    """A Channel and Message for the topic of positions, under a number that mrbt has not given."""
    begin = first_message(content)
    topic = POSITIONS.encode()
    body = struct.pack("<HH", 77, 1) + struct.pack("<I", len(topic)) + topic + bytes(8)
    channel = struct.pack("<BQ", mcap_file.CHANNEL, len(body)) + body
    forged = mcap_file.message(77, 1, BEGUN.epoch_ns, b'{"x":77}')
    found = parsed(content[:begin] + channel + forged + content[begin:])
    assert len(found.damage) >= 2
