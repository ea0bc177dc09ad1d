"""Messages as bytes: the same whether they go to a file or elsewhere."""

from __future__ import annotations

import json
from pathlib import Path

from mcap.reader import NonSeekingReader

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.recording.channels import DROPPED, LIFE
from mrbt_mesh.recording.messages import MessageEncoder, first_check, next_check
from mrbt_mesh.recording.metadata import RunMetadata
from mrbt_mesh.recording.writer import RecordingWriter
from tests.support.build import action, make_mission

METADATA = RunMetadata.of(make_mission(action("a1")), "A", "r1", Timing(), 7_000, "1.0")
MESSAGES = [
    (LIFE, {"event": "joined", "incarnation": "1.x"}),
    (DROPPED, {"number": 1, "author": "A\ud800", "name": "condition/c"}),
]


def test_each_check_is_over_the_one_before() -> None:
    encoder, before = MessageEncoder(METADATA), first_check(METADATA.to_values())
    for number, (topic, data) in enumerate(MESSAGES, start=1):
        at_ns, text = encoder.encode(topic, number, data)
        assert (at_ns, encoder.number) == (7_000 + number * 1_000, number)
        said = json.loads(text)
        check = bytes.fromhex(said.pop("check"))
        assert said == data
        body = text[: -len(f',"check":"{check.hex()}"}}')] + b"}"
        assert check == next_check(before, number, topic, at_ns, body)
        before = check


def test_a_file_holds_the_same_bytes(tmp_path: Path) -> None:
    encoder, writer = MessageEncoder(METADATA), RecordingWriter(tmp_path / "a.mcap", METADATA)
    for topic, data in MESSAGES:
        writer.write(topic, 5, data)
    writer.close()
    with (tmp_path / "a.mcap").open("rb") as stream:
        found = [message.data for _, _, message in NonSeekingReader(stream).iter_messages()]
    assert found == [encoder.encode(topic, 5, data)[1] for topic, data in MESSAGES]
