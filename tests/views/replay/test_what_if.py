"""Going on from a recording: what really happened comes out again, and other faults change it."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.recording.folder import observer_file, robot_file
from mrbt_mesh.recording.reader import Recording, RecordingError, read_recording
from mrbt_mesh.sim import Fault, Kill, Lose, Restore
from mrbt_mesh.views.replay.what_if import Continuation, what_if
from tests.support.recorded import record_example
from tests.support.runs import example

AT_US = 12_000_000
ENDED_US = 25_516_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which A1 dies at 12.5 s."""
    made = tmp_path_factory.mktemp("continued")
    result = record_example(made, "vehicle_repair", 7, [(12_500_000, Kill("A1"))])
    assert result.observer.record.ended_us == pytest.approx(ENDED_US, abs=20_000)
    return made


@pytest.fixture(scope="module")
def watched(folder: Path) -> Recording:
    return read_recording(observer_file(folder))


def go_on(
    recording: Recording, *faults: tuple[int, Fault], at_us: int = AT_US, again: bool = False
) -> Continuation:
    _, program = example("vehicle_repair")
    return what_if(
        recording, at_us, program, faults, without_recorded=not again, timeout_us=60_000_000
    )


def ended_us(found: Continuation) -> int:
    ended = found.result.observer.record.ended_us
    assert ended is not None
    return found.recorded_us(ended)


@pytest.mark.parametrize("whose", ["observer", "B1"])
def test_the_fault_that_happened_leads_to_what_happened(folder: Path, whose: str) -> None:
    path = observer_file(folder) if whose == "observer" else robot_file(folder, whose)
    found = go_on(read_recording(path), again=True)
    assert found.under_way == {"A1": "replace_hw(2)", "A2": "replace_hw(4)"}
    assert found.result.result == "success"
    assert ended_us(found) == pytest.approx(ENDED_US, abs=50_000)
    (fault,) = found.result.observer.record.major
    assert (fault.robot, fault.replacement) == ("A1", "B1")


def test_without_it_the_mission_is_over_earlier(watched: Recording) -> None:
    found = go_on(watched)
    assert found.result.result == "success"
    assert ended_us(found) < ENDED_US - 1_000_000
    done = found.result.summary["global_tasks"]
    assert done["remove_cover"]["status"] == "success"  # before it went on


def test_with_others_it_is_blocked(watched: Recording) -> None:
    found = go_on(watched, (AT_US, Kill("B1")), (AT_US, Kill("B2")))
    assert found.result.result == "blocked"
    assert any("use_soldering_iron" in row["reason"] for row in found.result.summary["blocked"])


def test_what_was_lost_before_is_lost_still(tmp_path: Path) -> None:
    both = [(1_000_000, Lose("B1", "all")), (1_000_000, Lose("B2", "all"))]
    result = record_example(tmp_path, "vehicle_repair", 7, both)
    assert result.result != "success"
    recording = read_recording(observer_file(tmp_path))
    assert go_on(recording).result.result == "blocked"
    again = go_on(recording, (AT_US + 1_000_000, Restore("B1", "all")))
    assert again.result.result == "success"


def test_where_nobody_is_alive_nothing_goes_on(watched: Recording) -> None:
    with pytest.raises(RecordingError, match="no robot of the mission is alive at that time"):
        go_on(watched, at_us=-1)
