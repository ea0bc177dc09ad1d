"""The runs on this machine, and which of them a command means if it names none."""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path

from mrbt_mesh.errors import nearest
from mrbt_mesh.runtime.launcher_lock import is_launched
from mrbt_mesh.runtime.run_dir import RUN_FILE, RunDir, RunDirError, state_dir, write_atomically

# How many runs are listed; older ones only while they run.
MOST_KNOWN = 50
HOW_TO_NAME = "--run-dir TEAM"


def remember(run_dir: RunDir) -> None:
    """Register this run as the newest on this machine. Raises RunDirError."""
    path = os.fsencode(run_dir.path.resolve())
    try:
        _folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        # Bytes, because the name of a folder does not depend on a command's locale.
        entry = _folder() / hashlib.sha256(path).hexdigest()[:16]
        write_atomically(entry, path.decode(errors="surrogateescape"))
    except OSError as error:
        raise RunDirError(f"cannot write the list of runs: {error}") from error
    for old, known in _entries()[MOST_KNOWN:]:
        if not is_running(known):
            old.unlink(missing_ok=True)


def known_runs() -> list[RunDir]:
    """Return the runs whose folders exist, newest first."""
    return [run_dir for _, run_dir in _entries() if (run_dir.path / RUN_FILE).is_file()]


def is_running(run_dir: RunDir) -> bool:
    """Return whether the run has a launcher or a robot on this machine."""
    return is_launched(run_dir) or any(run_dir.process(robot) for robot in run_dir.robots())


def find_run(named: Path | None, how: str = HOW_TO_NAME) -> RunDir:
    """Find a run, as `look_up_run`, that robots are commanded through.

    Raises InputError if its folder is a link, belongs to another user or is writable by others:
    they could name any process to be killed, or make robots do anything.
    """
    return RunDir.of(look_up_run(named, how).path)


def look_up_run(named: Path | None, how: str = HOW_TO_NAME) -> RunDir:
    """Find a run by its folder, or by the name of its team or mission; None: the running one.

    If several match and none runs, it is the newest one. `how`: how the command line names a run.
    For what only reads: evidence may lie in any folder. Raises RunDirError if there is no such run,
    or if several of them run.
    """
    if named is not None and (named / RUN_FILE).is_file():
        return RunDir(named)
    known = known_runs()
    possible = known if named is None else [run for run in known if str(named) in names_of(run)]
    if not possible and named is None:
        raise RunDirError(
            "no run is known here: start one with `mrbt up`, or name it with --run-dir"
        )
    if not possible:
        hint = nearest(str(named), {name for run in known for name in names_of(run)})
        raise RunDirError(
            f"{named} holds no run (no {RUN_FILE}), and no team has this name{hint}; see `mrbt ls`"
        )
    running = [run for run in possible if is_running(run)]
    if len(running) > 1:
        listed = "".join(f"\n  {team_name(run)}  {run.path}" for run in running)
        raise RunDirError(f"{len(running)} teams run here: name one with {how}{listed}")
    return (running or possible)[0]


def team_name(run_dir: RunDir) -> str:
    """Return the name of the run's team, or of its folder if the run is damaged."""
    return next(iter(names_of(run_dir)), run_dir.path.name)


def names_of(run_dir: RunDir) -> tuple[str, ...]:
    """Return the names of a run: its team and its mission; empty if it is damaged."""
    with contextlib.suppress(RunDirError):
        info = run_dir.info()
        return info.team, info.mission_name
    return ()


def _folder() -> Path:
    return state_dir() / "known"


def _entries() -> list[tuple[Path, RunDir]]:
    """Return (file that names a run, the run), newest first."""
    found: list[tuple[int, Path, RunDir]] = []
    for entry in _folder().glob("[!.]*"):
        with contextlib.suppress(OSError):  # another process has removed it
            found.append(
                (entry.stat().st_mtime_ns, entry, RunDir(Path(os.fsdecode(entry.read_bytes()))))
            )
    return [(entry, run_dir) for _, entry, run_dir in sorted(found, key=lambda each: -each[0])]
