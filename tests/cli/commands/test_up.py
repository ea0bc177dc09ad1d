"""mrbt up: options that do not go together; what it does is in tests/processes."""

from __future__ import annotations

from tests.support.command import EXPLORE, mrbt


def test_without_recordings_there_are_none_of_heartbeats() -> None:
    code, output, problems = mrbt("up", EXPLORE, "--no-record", "--record-beats")
    assert (code, output) == (2, "")
    assert "with --no-record nothing is recorded" in problems
