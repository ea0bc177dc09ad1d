"""Files of a run directory that are copies, or are called by another name."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from mrbt_mesh.recording.reader import Recording, named, read_recording
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.sim import Kill, Restart
from mrbt_mesh.views.replay.verify import verify
from tests.support.recorded import read_all, record_keyed


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Manifest]:
    folder = tmp_path_factory.mktemp("names")
    _, manifest = record_keyed(folder, "explore", 3)
    return folder, manifest


@pytest.mark.parametrize(
    ("copied", "name", "finding"),
    [
        ("recordings/R1.mcap", "recordings/R1.7.mcap", "was recorded in R1.7.mcap, too"),
        ("recordings/R1.mcap", "recordings/R9.mcap", "it is a recording of R1"),
        ("recordings/R1.mcap", "recordings/R1.part2.mcap", "R1.part2.mcap is part 1"),
        ("run.mcap", "run.2.mcap", "was recorded in run.2.mcap, too"),
    ],
)
def test_a_copy_is_named(
    run: tuple[Path, Manifest], tmp_path: Path, copied: str, name: str, finding: str
) -> None:
    folder, manifest = run
    shutil.copytree(folder, tmp_path / "run")
    shutil.copy(folder / copied, tmp_path / "run" / name)
    verdict = verify(read_all(tmp_path / "run"), manifest)
    assert any(finding in str(each) for each in verdict.findings), verdict.findings


@pytest.fixture(scope="module")
def restarted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Manifest]:
    folder = tmp_path_factory.mktemp("restarted")
    faults = ((1_000_000, Kill("R1")), (2_000_000, Restart("R1")))
    _, manifest = record_keyed(folder, "explore", 3, faults)
    return folder, manifest


@pytest.mark.parametrize(
    ("moved", "name", "finding"),
    [
        ("recordings/R1.mcap", "recordings/R1.3.mcap", "R1.3.mcap: it is the recording that"),
        ("recordings/R2.mcap", "recordings/R9.mcap", "R9.mcap: it is a recording of R2"),
        ("recordings/R2.mcap", "run.2.mcap", "run.2.mcap: it is a recording of R2"),
        ("run.mcap", "recordings/R7.mcap", "R7.mcap: it is a recording of an observer"),
    ],
)
def test_a_file_with_another_name_is_named(
    restarted: tuple[Path, Manifest], tmp_path: Path, moved: str, name: str, finding: str
) -> None:
    folder, manifest = restarted
    shutil.copytree(folder, tmp_path / "run")
    assert verify(read_all(tmp_path / "run"), manifest).is_proved
    (tmp_path / "run" / moved).rename(tmp_path / "run" / name)
    findings = verify(read_all(tmp_path / "run"), manifest).findings
    assert [str(each)[: len(finding)] for each in findings] == [finding]


@pytest.mark.parametrize(
    "name", ["run.99.mcap", "run.x.mcap", "run.02.mcap", "run.9999999999.mcap"]
)
def test_an_observers_file_with_another_number_is_named(
    restarted: tuple[Path, Manifest], tmp_path: Path, name: str
) -> None:
    """Also where nothing names it: no summary was signed, and nothing was recorded after it."""
    folder, manifest = restarted
    shutil.copytree(folder, tmp_path / "run")
    (tmp_path / "run" / "run.mcap").rename(tmp_path / "run" / name)
    findings = map(str, verify(read_all(tmp_path / "run"), manifest).findings)
    assert [*findings] == [f"{name}: it was written with another name: run.mcap was free"]


def test_observers_files_of_a_continued_run_keep_their_numbers(
    restarted: tuple[Path, Manifest], tmp_path: Path
) -> None:
    folder, manifest = restarted
    shutil.copytree(folder, tmp_path / "run")
    *robots, observer = read_all(tmp_path / "run")
    earlier = named([observer.path], observer.metadata.run)
    second = replace(observer, path=observer.path.with_name("run.2.mcap"))
    second = replace(second, metadata=replace(second.metadata, earlier=earlier))

    def findings(*observers: Recording) -> list[str]:
        found = verify([*robots, *observers], manifest).findings
        return [str(each) for each in found if "recorded in" not in each.text]

    changed = [each for each in findings(observer, second) if "name" in each or "calls" in each]
    assert changed == []
    shutil.copy(observer.path, observer.path.with_name("run.2.mcap"))
    third = replace(second, path=observer.path.with_name("run.3.mcap"))
    assert not any("another name" in each for each in findings(observer, third))
    swapped = findings(
        replace(second, path=observer.path),
        replace(observer, path=second.path),
    )
    assert any(
        "run.mcap: it is not run.mcap: it names that one as an earlier recording" in each
        for each in swapped
    )
    observer.path.unlink()
    moved = replace(observer, path=observer.path.with_name("run.3.mcap"))
    moved_found = findings(moved, second)
    assert "run.3.mcap: it was written with another name: run.mcap was free" in moved_found
    assert any(
        "run.3.mcap: it is the recording that run.2.mcap calls run.mcap" in e for e in moved_found
    )


def test_files_that_were_collected_may_have_any_name(
    restarted: tuple[Path, Manifest], tmp_path: Path
) -> None:
    folder, manifest = restarted
    for number, each in enumerate(read_all(folder)):
        shutil.copy(each.path, tmp_path / f"{number}.mcap")
    recordings = [read_recording(path) for path in sorted(tmp_path.iterdir())]
    verdict = verify(recordings, manifest)
    assert verdict.is_proved
    assert verdict.notes == (
        "0.mcap: it is a recording of R1",
        "1.mcap: it is a recording of R1",
        "2.mcap: it is a recording of R2",
        "3.mcap: it is a recording of an observer",
    )
