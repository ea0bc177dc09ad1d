"""What was recorded keeps its times, whatever the wall clock was set to meanwhile."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.recording.reader import Recording, RecordingError, open_recording
from mrbt_mesh.runtime import past
from mrbt_mesh.sim import Kill
from tests.support.recorded import record_example
from tests.support.runs import example


@pytest.mark.parametrize(
    ("clock", "is_kept"), [("this one", True), ("another", False), ("", False)]
)
def test_times_of_the_same_clock_are_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: str, is_kept: bool
) -> None:
    """A recording of another boot or machine is placed by the wall clock."""
    record_example(tmp_path, "explore", 1, [(2_000_000, Kill("R1"))])

    def opened(path: Path) -> Recording:
        recording = open_recording(path)
        return replace(recording, metadata=replace(recording.metadata, clock=clock))

    monkeypatch.setattr(past, "open_recording", opened)
    monkeypatch.setattr("mrbt_mesh.runtime.process_identity.clock_id", lambda: "this one")
    monkeypatch.setattr(past, "_epoch_us", lambda: 7_200_000_000)
    mission, _ = example("explore")
    timing = open_recording(next(tmp_path.glob("**/*.mcap"))).metadata.timing
    observer = Observer(mission, "sim1", timing, default_solver)
    try:
        past.tell_past(observer, tmp_path, 0.0, ())
    except RecordingError:
        pytest.fail("it was recorded whole")
    (fault,) = observer.record.major
    assert (fault.at_us == pytest.approx(2_000_000, abs=100_000)) is is_kept
