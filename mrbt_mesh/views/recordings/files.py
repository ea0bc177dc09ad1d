"""Which recordings a command line means."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import observer_files, robot_files
from mrbt_mesh.recording.reader import Recording, read_recording
from mrbt_mesh.runtime.known_runs import find_run
from mrbt_mesh.runtime.run_dir import KEYS_FOLDER

if TYPE_CHECKING:
    from mrbt_mesh.runtime.member_keys import Manifest


def chosen(paths: Sequence[Path]) -> tuple[list[Recording], Path | None]:
    """The recordings of files and run directories, by default of the run that `find_run` finds;
    and the folder of its keys, if it has one.

    Raises InputError for a folder without any, RecordingError for a file that is none.
    """
    files: list[Path] = []
    keys: Path | None = None
    for path in paths or (find_run(None, "RUN_DIR").path,):
        if not path.is_dir():
            files.append(path)
            continue
        found = [*robot_files(path), *observer_files(path)]
        if not found:
            raise InputError(f"{path} holds no recordings: was its run started with --no-record?")
        files += found
        if (path / KEYS_FOLDER).is_dir():
            keys = path / KEYS_FOLDER
    return [read_recording(file) for file in files], keys


def manifest_of(folder: Path | None) -> Manifest | None:
    """The team's manifest in the folder; raises KeysError."""
    if folder is None:
        return None
    from mrbt_mesh.runtime.key_folder import KeyFolder

    return KeyFolder(folder).manifest()
