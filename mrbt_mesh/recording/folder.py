"""Where the recordings of one run are.

run.mcap                what the observer of the run has received
recordings/ROBOT.mcap   what a robot knew and did; ROBOT.2.mcap in its second process, and so on
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

# A step writes little; a page of facts is some hundred kilobytes.
BUFFER_BYTES = 1 << 20
FOLDER, OBSERVERS, SUFFIX = "recordings", "run", ".mcap"


def robot_file(run_dir: Path, robot: str) -> Path:
    """Where a robot records in its first process."""
    return run_dir / FOLDER / f"{robot}{SUFFIX}"


def observer_file(run_dir: Path) -> Path:
    """The file of the observer."""
    return run_dir / f"{OBSERVERS}{SUFFIX}"


def open_new(path: Path) -> BinaryIO:
    """Open the file to be written; where there is one already, one with a number beside it.

    Its folder is made. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    number = 1
    while True:
        name = path.name if number == 1 else f"{path.stem}.{number}{path.suffix}"
        try:
            return path.with_name(name).open("xb", buffering=BUFFER_BYTES)
        except FileExistsError:
            number += 1


def observer_files(run_dir: Path) -> list[Path]:
    """The recordings of a run's observers, sorted."""
    names = (f"{OBSERVERS}{SUFFIX}", f"{OBSERVERS}.*{SUFFIX}")
    return sorted(path for name in names for path in run_dir.glob(name))


def robot_files(run_dir: Path) -> list[Path]:
    """The recordings of a run's robots, sorted."""
    return sorted((run_dir / FOLDER).glob(f"*{SUFFIX}"))
