"""Going on from any moment of a recorded run, with nothing changed, leads to the recorded run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.sim import (
    Freeze,
    Kill,
    Leave,
    Lose,
    Restart,
    Restore,
    Schedule,
    Thaw,
    simulate,
)
from mrbt_mesh.sim.world.faults import Operate
from mrbt_mesh.views.replay.what_if import what_if
from tests.support.depot import SECOND, depot, worker
from tests.support.effort import at_size
from tests.support.recorded import record_example
from tests.support.runs import example

# Of this many moments each run is continued from each `EVERY`-th.
MOMENTS, EVERY = 10, at_size(quick=10, gate=2, long=1)
# The simulation draws its own delays of messages.
NEAR_US = 50_000
RUNS: dict[str, tuple[str, int, Schedule]] = {
    "undisturbed": ("vehicle_repair", 7, ()),
    "death": ("vehicle_repair", 7, [(12_500_000, Kill("A1"))]),
    "restart": ("vehicle_repair", 3, [(12_500_000, Kill("A1")), (15_000_000, Restart("A1"))]),
    "loss": ("vehicle_repair", 5, [(4_000_000, Lose("A1", "all")), (9_000_000, Restore("A1"))]),
    "leave": ("vehicle_repair", 4, [(6_000_000, Leave("B1"))]),
    "freeze": ("vehicle_repair", 8, [(3_000_000, Freeze("B1")), (8_000_000, Thaw("B1"))]),
    "exclusive": ("dispense", 1, [(3_000_000, Kill("D1"))]),
    "coalitions": ("assembly", 2, ()),
    "bids": ("couriers", 3, ()),
    "team": (
        "inspection",
        6,
        [
            (2_000_000, Operate("R1", "paused", "pause")),
            (5_000_000, Operate("R1", "paused", "resume")),
        ],
    ),
}


def course(record: RunRecord, from_us: int) -> Iterator[tuple[Any, int]]:
    """(what, when) of all that happened after a time; times count from there."""
    for span in record.work_log.spans:
        if span.running_us is None:
            continue
        what = (span.robot, span.activation, span.local_task)
        if span.running_us > from_us:
            yield ("starts", *what), span.running_us - from_us
        if span.ended_us is not None and span.ended_us > from_us:
            yield (span.end, *what), span.ended_us - from_us
    for fault in record.major:
        if fault.detected_us is not None and fault.detected_us > from_us:
            yield ("dies", fault.robot, fault.replacement), fault.detected_us - from_us
    if record.ended_us is not None:
        yield (record.result,), record.ended_us - from_us


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_a_run_goes_on_as_it_did_from_any_moment(tmp_path: Path, name: str) -> None:
    mission, seed, schedule = RUNS[name]
    record_example(tmp_path, mission, seed, schedule)
    recording = read_recording(observer_file(tmp_path))
    whole = Player(recording)
    whole.seek(whole.end_us)
    record = whole.observer.record
    begun_us, ended_us = max(record.joined_us.values()), record.ended_us or whole.end_us
    begin = list(RUNS).index(name) % EVERY
    for moment in range(begin, MOMENTS, EVERY):
        at_us = begun_us + (ended_us - begun_us) * (2 * moment + 1) // (2 * MOMENTS)
        _, program = example(mission)
        found = what_if(recording, at_us, program, timeout_us=60_000_000)
        expected = sorted(course(record, at_us), key=repr)
        gone_on = sorted(course(found.result.observer.record, 0), key=repr)
        where = f"{name}, from {at_us / 1e6:.3f} s"
        assert [what for what, _ in gone_on] == [what for what, _ in expected], where
        for (what, again_us), (_, once_us) in zip(gone_on, expected, strict=True):
            assert abs(again_us - once_us) < NEAR_US, f"{where}: {what}, {again_us}, not {once_us}"


def test_robots_go_on_from_where_they_are_on_their_way(tmp_path: Path) -> None:
    mission = depot("Parallel: {success: all, children: [scan_at(a), lift_at(b), lift_at(a)]}")
    whole = simulate(mission, worker(), seed=1, record=tmp_path)
    recording = read_recording(observer_file(tmp_path))
    for at_s in (3, 12):
        found = what_if(recording, at_s * SECOND, worker(), timeout_us=60_000_000)
        ended_us = found.result.duration_us + at_s * SECOND
        assert found.result.result == "success"
        assert abs(ended_us - whole.duration_us) < NEAR_US, f"from {at_s} s"
