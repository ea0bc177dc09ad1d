"""Files of a run directory that are copies, or are called by another name."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from mrbt_mesh.recording.reader import read_recording
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
