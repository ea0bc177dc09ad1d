"""Where the recordings of one run are.

run.mcap                what the observer of the run has received
recordings/ROBOT.mcap   what a robot knew and did; ROBOT.2.mcap in its second process, and so on

A long recording goes on in ROBOT.part2.mcap and so on; its first parts may be gone.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import itertools
import os
import re
import stat
from collections.abc import Iterable, Iterator
from glob import escape
from pathlib import Path
from typing import BinaryIO

# A step writes little; a page of facts is some hundred kilobytes.
BUFFER_BYTES = 1 << 20
READ_BYTES = 1 << 16
FOLDER, OBSERVERS, SUFFIX = "recordings", "run", ".mcap"
_PROCESS = re.compile(r"\.[0-9]+$")
_PART = re.compile(r"\.part([1-9][0-9]{0,8})$")


def robot_file(run_dir: Path, robot: str) -> Path:
    """Return the file in which a robot records in its first process."""
    return run_dir / FOLDER / f"{robot}{SUFFIX}"


def observer_file(run_dir: Path) -> Path:
    """Return the file of the observer."""
    return run_dir / f"{OBSERVERS}{SUFFIX}"


def _for_owner(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def _for_owner_locked(path: str, flags: int) -> int:
    descriptor = _for_owner(path, flags)
    # Some network disks have no locks. `is_finished` holds this one for a moment at most.
    with contextlib.suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    return descriptor


def open_new(path: Path) -> BinaryIO:
    """Open a new file for writing; if it exists, a file with a number in its name.

    Its folder is created. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    while True:
        with contextlib.suppress(FileExistsError):
            return open_part(next(each for each in numbered(path) if not parts_of(each)))


def open_part(path: Path) -> BinaryIO:
    """Create a file that is private to its owner, and must not exist. Raises OSError.

    It is locked until it is closed, however its process ends: see `is_finished`.
    """
    return open(path, "xb", BUFFER_BYTES, opener=_for_owner_locked)


def is_finished(part: Path) -> bool:
    """Return whether it is certain that no process writes this file any more."""
    try:
        with open_regular(part) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading. Raises OSError, also for a pipe, to which nobody may ever write."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "it is not a regular file", str(path))
    return open(path, "rb", READ_BYTES)


def numbered(path: Path) -> Iterator[Path]:
    """Yield the files of the recordings of several processes, in order."""
    yield path
    for number in itertools.count(2):
        yield path.with_name(f"{path.stem}.{number}{path.suffix}")


def earlier_files(path: Path) -> list[Path]:
    """Return the first parts, which may be gone, of recordings of earlier processes."""
    return list(itertools.takewhile(parts_of, numbered(path)))


def part_path(path: Path, number: int) -> Path:
    """Return the file of a part of the recording whose first part is this file."""
    name = path.name if number == 1 else f"{path.stem}.part{number}{path.suffix}"
    return path.with_name(name)


def number_of_part(path: Path) -> int:
    """Return the number of a part; 1: the first part, or the only one."""
    found = _PART.search(path.stem)
    return int(found[1]) if found is not None else 1


def first_part(path: Path) -> Path:
    """Return the file of the first part, which may be gone, of this part's recording."""
    return path.with_name(_PART.sub("", path.stem) + path.suffix)


def name_of_owner(path: Path) -> str:
    """Return the robot after which a file is named; for an observer's, the name of its files."""
    return _PROCESS.sub("", first_part(path).stem)


def parts_of(path: Path) -> list[Path]:
    """Return the existing parts of the recording whose first part is this file, in order."""
    found = (each for each in path.parent.glob(f"{escape(path.stem)}.part*{path.suffix}"))
    later = [each for each in found if first_part(each) == path]
    return [*([path] if path.exists() else []), *sorted(later, key=number_of_part)]


def first_parts(paths: Iterable[Path]) -> list[Path]:
    """Return the files of the first parts, which may be gone, of these files' recordings."""
    return sorted({first_part(path) for path in paths})


def observer_files(run_dir: Path) -> list[Path]:
    """Return the recordings of a run's observers, all parts, sorted."""
    names = (f"{OBSERVERS}{SUFFIX}", f"{OBSERVERS}.*{SUFFIX}")
    return _in_order(path for name in names for path in run_dir.glob(name))


def robot_files(run_dir: Path) -> list[Path]:
    """Return the recordings of a run's robots, all parts, sorted."""
    return _in_order((run_dir / FOLDER).glob(f"*{SUFFIX}"))


def _in_order(paths: Iterable[Path]) -> list[Path]:
    return sorted(paths, key=lambda path: (first_part(path), number_of_part(path)))
