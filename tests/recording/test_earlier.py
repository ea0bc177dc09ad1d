"""Recordings as they were at an earlier time."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.recording.earlier import until
from mrbt_mesh.recording.metadata import RunMetadata
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.recording.writer import RecordingWriter
from tests.support.build import action, make_mission, task

MISSION = make_mission(action("a1"), {"A": {"t": 1}}, [task("a1", ("t", 1, 1))])


def test_a_recording_as_it_was_at_an_earlier_time(tmp_path: Path) -> None:
    metadata = RunMetadata.of(MISSION, "A", "r1", Timing(), 5_000_000_000, "1")
    recording = RecordingWriter(tmp_path / "a.mcap", metadata)
    for at_us in (1, 2, 2, 3):
        recording.write("/alive", at_us, {"robots": {"A": "1.x"}})
    recording.close()
    whole = read_recording(tmp_path / "a.mcap")
    assert until(whole, 5_000_003) is whole
    earlier = until(whole, 5_000_002)
    assert [each.at_us for each in earlier.records] == [1, 2, 2]
    assert earlier.last == (3, bytes.fromhex(whole.records.check_of(3)))
    assert earlier.cut_off_at is not None
    assert not until(whole, 5_000_000).records
