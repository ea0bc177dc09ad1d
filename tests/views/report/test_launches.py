"""Each launch of a continued run is reported, with the ends that its recordings have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from mrbt_mesh.recording.reader import RecordedMessages, Recording
from mrbt_mesh.runtime.command_log import CONTINUE, DOWN, NotedCommand
from mrbt_mesh.sim import Kill
from mrbt_mesh.views.replay.findings import End
from mrbt_mesh.views.replay.verify import verify
from mrbt_mesh.views.report.launches import launches_of
from mrbt_mesh.views.report.model import ENDED, NOT_KNOWN, RunParts, RunReport
from mrbt_mesh.views.report.page import report_html
from mrbt_mesh.views.report.sources import report_launches
from tests.support.recorded import read_all, record_example

# The Unix time of the first launch.
LAUNCH_S = 1_700_000_000


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    """R1 was killed first; then R2, which had noticed."""
    folder = tmp_path_factory.mktemp("killed")
    faults = [(1_000_000, Kill("R1")), (3_500_000, Kill("R2"))]
    record_example(folder, "explore", 3, faults, timeout_us=5_000_000)
    return launched(read_all(folder), 0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    folder = tmp_path_factory.mktemp("whole")
    assert record_example(folder, "explore", 3).result == "success"
    return launched(read_all(folder), 0)


def launched(recordings: Sequence[Recording], after_s: float) -> list[Recording]:
    """The recordings as those of a launch at this time, in real time."""
    epoch_ns = round((LAUNCH_S + after_s) * 1e9)
    return [replace(r, metadata=replace(r.metadata, epoch_ns=epoch_ns)) for r in recordings]


def later(recordings: Sequence[Recording], after_s: float) -> list[Recording]:
    """The recordings as those of a second launch."""
    names = [each.path.with_name(f"{each.path.stem}.2.mcap") for each in recordings]
    moved = launched(recordings, after_s)
    return [replace(each, path=path) for each, path in zip(moved, names, strict=True)]


def of_robots(recordings: Sequence[Recording]) -> list[Recording]:
    """As of a detached team."""
    found = [each for each in recordings if each.metadata.robot]
    return [replace(r, metadata=replace(r.metadata, is_observed=False)) for r in found]


def reported(
    recordings: Sequence[Recording], commands: Sequence[NotedCommand] = ()
) -> list[RunReport]:
    proof = replace(verify(recordings), commands=tuple(commands))
    return [*report_launches(recordings, "run", None, proof)]


def command(at_s: float, by: str) -> NotedCommand:
    return NotedCommand(1, LAUNCH_S + at_s, by, "a command", "operator")


def states(report: RunReport) -> dict[str, str]:
    return {each.robot: each.state for each in report.robots}


@pytest.mark.parametrize("is_detached", [False, True], ids=["observed", "detached"])
def test_a_launch_that_nobody_closed_says_what_verify_says(
    killed: list[Recording], whole: list[Recording], is_detached: bool
) -> None:
    both = [killed, later(whole, 100)]
    if is_detached:
        both = [of_robots(each) for each in both]
    first, second = reported([*both[0], *both[1]])
    assert verify([*both[0], *both[1]]).ends["R1.mcap"] is End.KILLED
    assert (first.result, second.result) == (NOT_KNOWN, "success")
    assert states(first) == {"R1": "dead", "R2": NOT_KNOWN}
    assert [each.robot for each in first.deaths] == ["R1"]
    assert states(second) == {"R1": "alive", "R2": "alive"}
    assert "the recordings of R2 end abruptly" in first.notes[-1]
    assert "No robot died" not in report_html(RunParts((first,)))
    assert "run.mcap" not in "".join(first.notes) or not is_detached


def test_a_death_that_the_reported_recording_lacks_is_told(killed: list[Recording]) -> None:
    """The observer was killed before R1; R2 noticed."""
    *robots, observer = killed
    end = next(i for i, us in enumerate(observer.records.times_us) if us > 900_000)
    records = RecordedMessages.joined([(observer.records, 0)], end)
    (report,) = reported([*robots, replace(observer, records=records, cut_off_at=1)])
    assert states(report)["R1"] == "dead"
    assert [each.robot for each in report.deaths] == ["R1"]


def test_commands_are_those_of_the_launch_that_they_began(
    killed: list[Recording], whole: list[Recording]
) -> None:
    both = [*of_robots(killed), *later(of_robots(whole), 100)]
    given = [command(1.5, "mrbt kill"), command(98.5, CONTINUE), command(101, "mrbt pause")]
    first, second = reported(both, given)
    assert [each.by for each in first.commands] == ["mrbt kill"]
    assert [each.by for each in second.commands] == [CONTINUE, "mrbt pause"]
    assert " s before</td>" in report_html(RunParts((second,)))
    assert "launches" not in " ".join((*first.notes, *second.notes))


def test_a_launch_that_an_operator_ended_has_ended(killed: list[Recording]) -> None:
    (report,) = reported(killed, [command(1.9, DOWN)])
    assert report.result == ENDED
    (report,) = reported(killed, [command(60, DOWN)])
    assert report.result == NOT_KNOWN, "nothing ran any more"


def test_launches_without_a_recording_are_named(whole: list[Recording]) -> None:
    third = later(whole, 100)
    (report,) = reported(third, [command(50, CONTINUE), command(99, CONTINUE)])
    assert report.notes[-1].endswith(
        "of 3 launches those without a recording here are left out: 1, 2"
    )
    (report,) = reported(whole, [command(50, CONTINUE)])
    assert report.notes[-1].endswith("of 2 launches those without a recording here are left out: 2")


def test_between_two_launches_nobody_records(
    killed: list[Recording], whole: list[Recording]
) -> None:
    found = launches_of([*later(whole, 100), *killed])
    assert [len(each.recordings) for each in found] == [len(killed), len(whole)]
    assert [each.shown[0].name for each in found] == ["run.mcap", "run.2.mcap"]
    assert len(launches_of([*killed, *later(whole, 0.5)])) == 1
