"""mrbt watch: options that do not go together; what it does is in tests/processes."""

from __future__ import annotations

from tests.support.command import EXPLORE, mrbt


def test_heartbeats_are_a_part_of_a_recording() -> None:
    words = ("watch", "--mission", EXPLORE, "--timeout", "1", "--record-beats")
    code, output, problems = mrbt(*words)
    assert (code, output) == (2, "")
    assert "--record-beats: of a recording: give --record as well" in problems
