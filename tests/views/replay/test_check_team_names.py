"""Files of a run directory that are copies, or are called by another name."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from mrbt_mesh.runtime.member_keys import Manifest
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
