"""The recordings that a command line names, and the other files of their run."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.earlier import until
from mrbt_mesh.recording.folder import first_parts, observer_files, robot_files
from mrbt_mesh.recording.reader import EmptyRecordingError, Recording, read_recordings
from mrbt_mesh.runtime.known_runs import is_running, look_up_run
from mrbt_mesh.runtime.run_dir import KEYS_FOLDER, RUN_FILE, RunDir

if TYPE_CHECKING:
    from mrbt_mesh.runtime.member_keys import Manifest
    from mrbt_mesh.views.replay.findings import Verification

_ONCE = "so that each recording is there once"


@dataclass(frozen=True)
class ChosenRecordings:
    """Recordings, and the messages of files that contain no recording yet.

    `run_dir` is that of the run, if one was given. `keys` is the folder of its keys, if that has a
    manifest.
    """

    recordings: tuple[Recording, ...]
    empty: tuple[str, ...]
    run_dir: Path | None
    keys: Path | None


def chosen(paths: Sequence[Path]) -> ChosenRecordings:
    """Return the recordings of files and run directories.

    Raises InputError for a folder without recordings, RecordingError for an invalid file.
    """
    from mrbt_mesh.runtime.key_folder import MANIFEST_FILE

    files: list[Path] = []
    run_dir: Path | None = None
    for path in paths:
        if not path.is_dir():
            files.append(path)
            continue
        found = [*robot_files(path), *observer_files(path)]
        if not found:
            raise InputError(f"{path} holds no recordings: was its run started with --no-record?")
        files += first_parts(found)
        run_dir = run_dir or path
    taken: dict[Path, Path] = {}
    for file in files:
        try:
            real = (
                Path(os.path.realpath(file, strict=True)) if file.is_symlink() else file.resolve()
            )
        except OSError as error:
            raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None
        if (first := taken.get(real)) is not None:
            if file.is_symlink() and run_dir is not None and len(paths) < 2:
                raise InputError(f"{file} is a link to {first}: remove it, {_ONCE}")
            raise InputError(f"{file} is given twice: name each recording once")
        taken[real] = file
    recordings: list[Recording] = []
    empty: list[EmptyRecordingError] = []
    for file in files:
        try:
            recordings += read_recordings(file)
        except EmptyRecordingError as error:
            empty.append(error)
    if not recordings:
        raise empty[0]
    keys = run_dir / KEYS_FOLDER if run_dir is not None else None
    if keys is not None and not (keys / MANIFEST_FILE).exists():
        keys = None
    return ChosenRecordings(tuple(recordings), tuple(map(str, empty)), run_dir, keys)


def verified(paths: Sequence[Path], keys: Path | None = None) -> Verification:
    """Return the findings of `mrbt recording verify`, by default of the run of `look_up_run`.

    `keys` is the folder with the team's manifest. Raises InputError.
    """
    from mrbt_mesh.views.replay.check_files import read_run_dir_files
    from mrbt_mesh.views.replay.verify import verify

    # Files are read one after the other, and of a running team they grow meanwhile: what each had
    # at this time fits what the others had.
    paths, now_us = paths or (look_up_run(None, "RUN_DIR").path,), time.time_ns() // 1_000
    running = {path for path in paths if _is_at_work(path)}
    found = chosen(paths)
    recordings, manifest = found.recordings, manifest_of(keys or found.keys)
    if found.run_dir is None:
        return verify(recordings, manifest, None, found.empty)
    files = read_run_dir_files(found.run_dir)
    # A team that ends meanwhile was at work when its recordings were read.
    if found.run_dir in running or _is_at_work(found.run_dir):
        files = replace(files, is_running=True)
        begun = tuple(each for each in (until(r, now_us) for r in recordings) if each.records)
        recordings = begun or recordings
    return verify(recordings, manifest, files, found.empty)


def _is_at_work(run_dir: Path) -> bool:
    return (run_dir / RUN_FILE).is_file() and is_running(RunDir(run_dir))


def manifest_of(folder: Path | None) -> Manifest | None:
    """Return the team's manifest in the folder; raises KeysError."""
    if folder is None:
        return None
    from mrbt_mesh.runtime.key_folder import KeyFolder

    return KeyFolder(folder).manifest()
