"""What users start from: the project's examples, drills and robot programs, and templates."""

from __future__ import annotations

import re
from pathlib import Path

from mrbt_mesh.core.mission.names import MAX_NAME
from mrbt_mesh.errors import InputError, nearest

MISSION = "mission.yaml"
TEMPLATE = Path(__file__).with_name("template")
# How an example names its robots' program; in a copy, the program lies beside the mission.
_PROGRAM = re.compile(r"\.\./\.\./agents/(\w+\.py)")
_NAME = re.compile(r"^mission: \w+$", re.MULTILINE)
_COMPILED = "__pycache__"
_IMPORT = re.compile(r"^(?:from|import) (\w+)", re.MULTILINE)


class FolderInUseError(InputError):
    """The place for the new files is a file, or a folder that has something in it."""


class UnknownExampleError(InputError):
    """There is no example of this name; the message suggests the nearest one."""


def shipped(folder: str) -> Path:
    """Return the folder `examples`, `agents` or `drills` of an installed package or a clone.

    The folders keep their places relative to each other, so that missions find their programs.
    """
    package = Path(__file__).parents[1]
    installed = package / "share" / folder
    return installed if installed.is_dir() else package.parent / folder


def examples() -> list[str]:
    """Return the names of the examples, sorted."""
    return sorted(path.parent.name for path in shipped("examples").glob(f"*/{MISSION}"))


def example_mission(name: str) -> Path:
    """Return the mission file of an example; raises UnknownExampleError."""
    known = examples()
    if name not in known:
        raise UnknownExampleError(f"there is no example {name!r}{nearest(name, known)}")
    return shipped("examples") / name / MISSION


def template_files(name: str, template: Path = TEMPLATE) -> dict[str, str]:
    """Return a small mission called `name` and a robot program for it: texts by file name.

    `template` is a folder with other files, for robots of another kind.
    """
    paths = sorted(path for path in template.iterdir() if path.is_file())
    files = {path.name: path.read_text(encoding="utf-8") for path in paths}
    return files | {MISSION: _NAME.sub(f"mission: {name}", files[MISSION])}


def mission_name(text: str) -> str:
    """Make a mission name from the name of a file or folder: letters, digits and _, at most 64."""
    name = "".join(c if c.isascii() and c.isalnum() else "_" for c in text)
    return (name if name[:1].isalpha() else f"mission_{name}")[:MAX_NAME]


def example_files(name: str) -> dict[str, str]:
    """Return an example and the programs of its robots: texts by path below one folder.

    Raises UnknownExampleError.
    """
    found: dict[str, str] = {}
    programs: list[str] = []
    folder = example_mission(name).parent
    for path in sorted(folder.rglob("*")):
        if path.is_dir() or path.parent.name == _COMPILED:
            continue
        text = path.read_text(encoding="utf-8")
        programs += _PROGRAM.findall(text)
        found[path.relative_to(folder).as_posix()] = _PROGRAM.sub(r"\1", text)
    while programs:
        program = programs.pop()
        path = shipped("agents") / program
        if program not in found and path.is_file():
            found[program] = path.read_text(encoding="utf-8")
            programs += [f"{module}.py" for module in _IMPORT.findall(found[program])]
    return found


def write_files(folder: Path, files: dict[str, str]) -> list[Path]:
    """Write files to `folder`, which may not exist yet.

    Returns the paths of the new files. Raises FolderInUseError rather than overwrite anything, and
    OSError if the folder cannot be written to.
    """
    if folder.exists() and not folder.is_dir():
        raise FolderInUseError(f"{folder}: is a file; name a new folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise FolderInUseError(f"{folder}: is not empty; name a new folder")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in files.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        # "x" refuses a file that appeared since the check above.
        with target.open("x", encoding="utf-8") as stream:
            stream.write(text)
        written.append(target)
    return written
