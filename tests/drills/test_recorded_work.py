"""What robots did, by their recordings: as their programs say, and what these leave out."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.drills.physical import spans
from mrbt_mesh.drills.recorded_work import read_work
from mrbt_mesh.sim import Freeze, Kill, Thaw
from tests.support.recorded import record_example


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, object]]]:
    """A run with a death and a freeze, and what its program says of it."""
    folder = tmp_path_factory.mktemp("work")
    faults = ((3_000_000, Freeze("B1")), (8_000_000, Thaw("B1")), (12_500_000, Kill("A1")))
    return folder, list(record_example(folder, "vehicle_repair", 7, faults).events)


def test_recordings_have_all_that_programs_say(
    recorded: tuple[Path, list[dict[str, object]]],
) -> None:
    folder, said = recorded
    events, robots = read_work(folder)
    assert robots == {"A1", "A2", "B1", "B2", "C1", "C2"}
    seen, wanted = spans(events), spans(said)
    assert len(seen) == len(wanted)
    for one, other in zip(seen, wanted, strict=True):
        assert (one.robot, one.ground, one.global_task) == (
            other.robot,
            other.ground,
            other.global_task,
        )
        assert one.start_s == pytest.approx(other.start_s, abs=0.3)
        if other.end is not None:
            assert one.end == other.end


def test_files_that_are_no_recordings_are_those_of_robots_that_recorded_nothing(
    tmp_path: Path,
) -> None:
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "A1.mcap").write_bytes(bytes(100))
    assert read_work(tmp_path) == ([], set())
