"""Who comes late is told what was recorded, and goes on from there as if it had always watched."""

from __future__ import annotations

import shutil
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.folder import observer_file, robot_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.past import tell_past
from mrbt_mesh.sim import Kill, Restart
from mrbt_mesh.views.model.team_view import TeamView
from tests.support.recorded import record_example

KILLED_US = 12_500_000
KINDS = ("work", "fault", "event")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("past")
    record_example(made, "vehicle_repair", 7, [(KILLED_US, Kill("A1"))])
    return made


def late(folder: Path, like: Path | None = None, living: Collection[str] = ()) -> Observer:
    """An observer of the recorded run that was told of its past, while these robots live."""
    metadata = read_recording(like or observer_file(folder)).metadata
    mission = metadata.read_mission("a test")
    observer = Observer(mission, metadata.run, metadata.timing, default_solver)
    tell_past(observer, folder, time.time() - 20, living)
    return observer


def timeline(observer: Observer) -> Mapping[str, Any]:
    view = TeamView(observer)
    view.update(boottime_us())
    found = view.changes.since(0)
    return {key: value for key, value in found.items() if key.partition("/")[0] in KINDS}


def still_written(source: Path, target: Path, share: float) -> None:
    """The first part of a recording, which ends in the middle of a message."""
    content = source.read_bytes()
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(content[: round(len(content) * share)])


def test_all_of_a_run_that_is_over(folder: Path) -> None:
    player = Player(read_recording(observer_file(folder)))
    player.seek(player.end_us)
    observer = late(folder)
    assert timeline(observer) == timeline(player.observer)
    assert observer.record.result is not None
    assert observer.record.unwatched == [], "nothing comes any more that could be missed"


def test_times_are_those_of_this_machines_clock(folder: Path, tmp_path: Path) -> None:
    """The recording's Unix times begin with 0, as those of all simulated runs."""
    still_written(observer_file(folder), observer_file(tmp_path), 0.6)
    observer = late(tmp_path)
    started_us, now_us = observer.record.started_us, boottime_us()
    assert started_us is not None
    epoch_us = time.time() * 1e6 - now_us
    assert started_us + epoch_us == pytest.approx(0, abs=5_000_000)


def test_of_a_run_that_goes_on_what_no_recording_holds_is_noted(
    folder: Path, tmp_path: Path
) -> None:
    still_written(observer_file(folder), observer_file(tmp_path), 0.6)
    cut = read_recording(observer_file(tmp_path))
    observer = late(tmp_path)
    record = observer.record
    ((from_us, to_us),) = record.unwatched
    told_us = cut.records[-1].at_us - cut.records[0].at_us
    assert record.started_us is not None
    assert from_us is not None
    assert from_us - record.started_us == pytest.approx(told_us, abs=100_000)
    assert abs(to_us - boottime_us()) < 60_000_000
    assert record.is_catching_up
    assert observer.membership.peers == {}, "who lives has yet to be heard"
    assert len(observer.facts.map) > 0


def test_what_is_still_recorded_is_whole_although_nothing_happens(
    folder: Path, tmp_path: Path
) -> None:
    still_written(observer_file(folder), observer_file(tmp_path), 0.6)
    ((from_us, to_us),) = late(tmp_path, living=["B1"]).record.unwatched
    assert from_us is not None
    assert to_us - from_us < 60_000_000, "no longer than it took to read it"
    robot = robot_file(tmp_path / "robots", "A1")
    still_written(robot_file(folder, "A1"), robot, 0.9)
    ((from_us, to_us),) = late(robot.parent.parent, robot, ["B1"]).record.unwatched
    assert from_us is not None
    assert to_us - from_us > 10**12, "A1's process is gone: nothing is known since"


def test_without_one_who_watched_a_robots_recording_tells(folder: Path, tmp_path: Path) -> None:
    """Of a team that was left alone; a newer file of another run is passed over."""
    for robot in ("A1", "B1"):
        still_written(robot_file(folder, robot), robot_file(tmp_path, robot), 0.9)
    record_example(tmp_path / "other", "explore", 3)
    shutil.copy(observer_file(tmp_path / "other"), observer_file(tmp_path))
    observer = late(tmp_path, robot_file(tmp_path, "B1"))
    (fault,) = observer.record.major
    assert (fault.robot, fault.replacement is not None) == ("A1", True)
    assert observer.record.started_us is not None
    died_us = fault.at_us - observer.record.started_us
    assert died_us == pytest.approx(KILLED_US, abs=200_000)


def test_a_run_without_recordings_was_not_watched(folder: Path, tmp_path: Path) -> None:
    observer = late(tmp_path, observer_file(folder))
    record = observer.record
    assert record.started_us is not None
    assert record.unwatched[0][0] == record.started_us
    assert record.unwatched[0][1] - record.started_us == pytest.approx(20e6, abs=5e6)
    assert not record.timeline


def test_what_is_no_recording_is_said_and_not_told(folder: Path, tmp_path: Path) -> None:
    observer_file(tmp_path).write_text("nonsense")
    observer = late(tmp_path, observer_file(folder))
    ((_, text),) = observer.record.timeline
    assert "is not an mrbt recording" in text
    assert len(observer.record.unwatched) == 1


BACK_US, DIED_US = 14_500_000, 17_000_000


@pytest.fixture(scope="module")
def restarted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A1 dies and comes back; then B1 dies. No observer recorded."""
    made = tmp_path_factory.mktemp("restarted")
    faults = [(KILLED_US, Kill("A1")), (BACK_US, Restart("A1")), (DIED_US, Kill("B1"))]
    record_example(made, "vehicle_repair", 7, faults)
    return made


def deaths(observer: Observer) -> list[tuple[str, int]]:
    """Who died when, in tenths of a second of the run."""
    started_us = observer.record.started_us
    assert started_us is not None
    return [(each.robot, (each.at_us - started_us) // 100_000) for each in observer.record.major]


def only(folder: Path, target: Path, *names: str) -> None:
    (target / "recordings").mkdir()
    for name in names:
        source = folder / "recordings" / name
        shutil.copy(source, target / "recordings" / name)


def test_where_one_recording_ends_another_one_goes_on(restarted: Path, tmp_path: Path) -> None:
    """B1 records until its death, A1's second process from its own on: together all of it."""
    only(restarted, tmp_path, "B1.mcap", "A1.2.mcap")
    observer = late(tmp_path, robot_file(tmp_path, "B1"))
    whole = late(restarted, observer_file(restarted))
    assert [robot for robot, _ in deaths(observer)] == ["A1", "B1"]
    for (_, seen), (_, known) in zip(deaths(observer), deaths(whole), strict=True):
        assert abs(seen - known) <= 5
    assert observer.record.result is whole.record.result is Status.SUCCESS
    assert observer.record.unwatched == []
    begun = {task: row.state for task, row in observer.record.task_log.tasks.items()}
    assert begun == {task: row.state for task, row in whole.record.task_log.tasks.items()}
    done, known_done = (
        sorted(text for _, text in each.record.timeline if text.endswith(" done"))
        for each in (observer, whole)
    )
    assert done == known_done, "nothing is told twice"
    times_us = [at_us for at_us, _ in observer.record.timeline]
    assert times_us == sorted(times_us)


def test_what_no_recording_holds_in_the_middle_is_noted(restarted: Path, tmp_path: Path) -> None:
    only(restarted, tmp_path, "A1.mcap", "A1.2.mcap")
    observer = late(tmp_path, robot_file(tmp_path, "A1"))
    ((from_us, to_us),) = observer.record.unwatched
    started_us = observer.record.started_us
    assert from_us is not None
    assert started_us is not None
    assert from_us - started_us == pytest.approx(KILLED_US, abs=1_500_000)
    assert to_us - started_us == pytest.approx(BACK_US, abs=500_000)
    assert [robot for robot, _ in deaths(observer)] == ["A1", "B1"]
    assert observer.record.result is Status.SUCCESS


def test_the_recording_of_an_earlier_process_is_not_whole_until_now(
    restarted: Path, tmp_path: Path
) -> None:
    only(restarted, tmp_path, "A1.mcap")
    still_written(
        restarted / "recordings" / "A1.2.mcap", tmp_path / "recordings" / "A1.2.mcap", 0.5
    )
    observer = late(tmp_path, robot_file(tmp_path, "A1"), ["A1"])
    gap, last = observer.record.unwatched
    assert gap[0] is not None
    assert gap[1] - gap[0] == pytest.approx(BACK_US - KILLED_US, abs=1_500_000)
    assert last[0] is not None
    assert last[1] - last[0] < 60_000_000, "A1 records now"
