"""A recording names those that were there when it began: they must be here, as they were."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mrbt_mesh.recording.folder import robot_file
from mrbt_mesh.recording.reader import named
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.sim import Kill, Restart
from mrbt_mesh.views.replay.check_named import check_named
from mrbt_mesh.views.replay.findings import GapKind, Verification
from mrbt_mesh.views.replay.verify import verify
from tests.support.recorded import read_all, record_keyed, with_one_more

FAULTS = ((4_000_000, Kill("A1")), (6_000_000, Restart("A1")))


@pytest.fixture
def run(tmp_path: Path) -> tuple[Path, Manifest]:
    """A run in which A1 was killed and restarted, so that it has two recordings."""
    _, manifest = record_keyed(tmp_path, "vehicle_repair", 7, FAULTS)
    return tmp_path, manifest


def verified(run: tuple[Path, Manifest]) -> Verification:
    return verify(read_all(run[0]), run[1])


def test_a_second_recording_names_the_first_as_it_was(run: tuple[Path, Manifest]) -> None:
    first, second = read_all(run[0])[0:2]
    if first.path.name != "A1.mcap":
        first, second = second, first
    (one,) = second.metadata.earlier
    assert (one.name, first.metadata.earlier) == ("A1.mcap", ())
    assert one == named([first.path], first.metadata.run)[0]
    assert (one.number, one.check) == (first.last[0], first.last[1].hex())
    assert verified(run).is_proved


def test_a_recording_that_was_removed_is_missed(run: tuple[Path, Manifest]) -> None:
    robot_file(run[0], "A1").unlink()
    gaps = [gap for gap in verified(run).gaps if gap.kind is GapKind.NAMED]
    assert [str(gap) for gap in gaps] == [
        "A1.mcap: it is missing, and A1.2.mcap names it: give all recordings of the run"
    ]


def test_an_end_that_was_removed_is_missed_also_where_it_was_not_signed(
    run: tuple[Path, Manifest],
) -> None:
    path = robot_file(run[0], "A1")
    os.truncate(path, path.stat().st_size - 1)
    assert [gap.of for gap in verified(run).gaps if gap.kind is GapKind.NAMED] == ["A1.mcap"]


def test_another_end_is_a_change(run: tuple[Path, Manifest]) -> None:
    """Behind the last signature of a killed robot all checks can be made anew without a key."""
    first = next(each for each in read_all(run[0]) if each.name == "A1.mcap")
    assert not first.has(first.last[0], "0" * 32)
    second = next(each for each in read_all(run[0]) if each.name == "A1.2.mcap")
    (one,) = second.metadata.earlier
    (finding,) = check_named("A1.2.mcap", [one._replace(check="0" * 32)], [first])
    assert "is not what was there before (contradicted by A1.2.mcap)" in str(finding)


def test_nothing_is_named_of_another_run_or_of_what_holds_nothing(tmp_path: Path) -> None:
    record_keyed(tmp_path, "explore", 3)
    path, run = robot_file(tmp_path, "R1"), read_all(tmp_path)[-1].metadata.run
    assert [each.name for each in named([path], run)] == ["R1.mcap"]
    assert named([path], "another run") == ()
    os.truncate(path, 10)
    assert named([path], run) == ()


def test_what_is_added_to_a_finished_recording_is_a_change(run: tuple[Path, Manifest]) -> None:
    """A1 was killed: only the recording of its next process shows where the first one ended."""
    path = robot_file(run[0], "A1")
    killed = next(each for each in read_all(run[0]) if each.path == path)
    path.write_bytes(with_one_more(killed))
    number = killed.last[0]
    assert [str(each) for each in verified(run).findings] == [
        f"A1.mcap: record {number + 1}: what follows was added: record {number} was the last when "
        "A1.2.mcap was written (contradicted by A1.2.mcap)"
    ]


def test_what_goes_on_is_named_up_to_there_and_may_grow(tmp_path: Path) -> None:
    record_keyed(tmp_path, "explore", 3)
    recordings = read_all(tmp_path)
    (whole,) = named([recordings[0].path], recordings[0].metadata.run)
    assert whole.is_finished
    number = whole.number - 1
    earlier = whole._replace(number=number, check=recordings[0].records.check_of(number))
    assert len([*check_named("a", [earlier], recordings)]) == 1
    assert [*check_named("a", [earlier._replace(is_finished=False)], recordings)] == []
