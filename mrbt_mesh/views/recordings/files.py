"""Which recordings a command line means."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import observer_files, robot_files
from mrbt_mesh.recording.reader import Recording, read_recording
from mrbt_mesh.runtime.known_runs import find_run
from mrbt_mesh.runtime.run_dir import KEYS_FOLDER, SUMMARY_FILE

if TYPE_CHECKING:
    from mrbt_mesh.runtime.member_keys import Manifest
    from mrbt_mesh.views.replay.check_summary import SummaryFile


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


def summary_of(paths: Sequence[Path]) -> SummaryFile | None:
    """The summary of the run directory that has one; raises InputError."""
    from mrbt_mesh.runtime.summary_signature import SIGNATURE_FILE
    from mrbt_mesh.views.replay.check_summary import SummaryFile

    for path in paths or (find_run(None, "RUN_DIR").path,):
        file, signature = path / SUMMARY_FILE, path / SIGNATURE_FILE
        try:
            if file.is_file():
                text = signature.read_text("utf-8", "replace") if signature.is_file() else ""
                return SummaryFile(file.read_bytes(), text)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    return None


def manifest_of(folder: Path | None) -> Manifest | None:
    """The team's manifest in the folder; raises KeysError."""
    if folder is None:
        return None
    from mrbt_mesh.runtime.key_folder import KeyFolder

    return KeyFolder(folder).manifest()
