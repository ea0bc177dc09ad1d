"""Where a team is launched: what cannot be begun leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.cli.launching import continued, created
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime import run_dir as run_dir_module
from mrbt_mesh.runtime.run_dir import RunDir
from tests.support.paths import mission_file
from tests.support.run_dirs import a_run


@pytest.fixture
def read_only_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "state").touch()
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path / "state"))


@pytest.mark.usefixtures("read_only_state")
def test_a_run_that_cannot_be_listed_is_not_begun(tmp_path: Path) -> None:
    info, mission = a_run(tmp_path / "known", {}).info(), load_mission(mission_file("explore"))
    with pytest.raises(InputError, match="cannot write the list of runs"):
        created(tmp_path / "r", info, mission)
    assert not (tmp_path / "r").exists()
    (tmp_path / "mine").mkdir(mode=0o700)
    (tmp_path / "mine" / "notes").touch()
    with pytest.raises(InputError, match="cannot write the list of runs"):
        created(tmp_path / "mine", info, mission)
    assert [each.name for each in (tmp_path / "mine").iterdir()] == ["notes"]


@pytest.mark.usefixtures("read_only_state")
def test_nor_is_it_continued(tmp_path: Path) -> None:
    run_dir = a_run(tmp_path / "r", {})
    before = {each.name: each.read_bytes() for each in run_dir.path.iterdir()}
    with pytest.raises(InputError, match="cannot write the list of runs"):
        continued(run_dir.path, run_dir.info(), load_mission(mission_file("explore")))
    assert {each.name: each.read_bytes() for each in run_dir.path.iterdir()} == before


def test_a_run_directory_that_is_written_in_part_is_taken_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info, write = a_run(tmp_path / "known", {}).info(), run_dir_module.write_atomically

    def full(path: Path, text: str) -> None:
        if path.name == "run.json":
            raise OSError(28, "No space left on device")
        write(path, text)

    monkeypatch.setattr(run_dir_module, "write_atomically", full)
    with pytest.raises(InputError, match=r"run\.json cannot be written: No space left on device"):
        RunDir.create(tmp_path / "r", info, "{}")
    assert not (tmp_path / "r").exists()
