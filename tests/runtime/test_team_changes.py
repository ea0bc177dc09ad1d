"""Programs that stay open notice that a team is found at other places, or not any more."""

from __future__ import annotations

import shutil
from pathlib import Path

from mrbt_mesh.runtime.run_dir import RunDir, RunDirError
from mrbt_mesh.runtime.session_config import TransportConfig
from mrbt_mesh.runtime.team_changes import LOOK_US, TeamChanges

OLD = TransportConfig("t", "", connect=("tcp/127.0.0.1:1",))
NEW = TransportConfig("t", "", connect=("tcp/127.0.0.1:2",))


class Desk:
    """A run directory that says where its team is."""

    def __init__(self, path: Path) -> None:
        self.says: TransportConfig | RunDirError = OLD
        self.reads = 0
        self.changes = TeamChanges(RunDir(path), OLD, self._read)

    def _read(self, _: RunDir) -> TransportConfig:
        self.reads += 1
        if isinstance(self.says, RunDirError):
            raise self.says
        return self.says


def test_other_places_are_told_once(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    assert desk.changes.look(0) is None
    desk.says = NEW
    assert desk.changes.look(LOOK_US - 1) is None
    assert desk.reads == 1, "it looks now and then"
    assert desk.changes.look(LOOK_US) == NEW
    assert desk.changes.look(2 * LOOK_US) is None


def test_a_damaged_and_a_deleted_run_directory_are_problems(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    desk = Desk(folder)
    desk.says = RunDirError("run.json is damaged")
    assert (desk.changes.look(0), desk.changes.problem) == (None, "run.json is damaged")
    desk.says = NEW
    assert (desk.changes.look(LOOK_US), desk.changes.problem) == (NEW, "")
    shutil.rmtree(folder)
    assert desk.changes.look(2 * LOOK_US) is None
    assert desk.changes.problem == f"the run directory {folder} was deleted"
