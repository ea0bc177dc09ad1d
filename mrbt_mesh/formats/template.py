"""Write a small mission and robot of the user's own, as `mrbt new` does."""

from __future__ import annotations

from pathlib import Path

_FOLDER = Path(__file__).with_name("template")
_FILES = ("mission.yaml", "robot.py")


class FolderInUseError(FileExistsError):
    """The place for the new files is a file, or a folder that has something in it."""


def write_template(folder: Path) -> list[Path]:
    """Write `mission.yaml` and `robot.py` to `folder`, which may not exist yet.

    Returns the paths of the new files. Raises FolderInUseError rather than overwrite
    anything, and OSError if the folder cannot be written to.
    """
    if folder.exists() and not folder.is_dir():
        raise FolderInUseError(f"{folder}: is a file; name a new folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise FolderInUseError(f"{folder}: is not empty; name a new folder")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name in _FILES:
        target = folder / name
        # "x" refuses a file that appeared since the check above.
        with target.open("x", encoding="utf-8") as stream:
            stream.write((_FOLDER / name).read_text(encoding="utf-8"))
        written.append(target)
    return written
