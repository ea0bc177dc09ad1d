"""What comes with the project beside its code: examples, their robots' programs, drills."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.errors import InputError, nearest

MISSION = "mission.yaml"


class UnknownExampleError(InputError):
    """There is no example of this name; the message lists those there are."""


def shipped(folder: str) -> Path:
    """The folder `examples`, `agents` or `drills`: in an installed package, else in a clone.

    They keep their places relative to each other, so that missions find their programs.
    """
    package = Path(__file__).parents[1]
    installed = package / "share" / folder
    return installed if installed.is_dir() else package.parent / folder


def examples() -> list[str]:
    """The names of the examples, sorted."""
    return sorted(path.parent.name for path in shipped("examples").glob(f"*/{MISSION}"))


def example_mission(name: str) -> Path:
    """The mission file of an example; raises UnknownExampleError."""
    known = examples()
    if name not in known:
        raise UnknownExampleError(f"there is no example {name!r}{nearest(name, known)}")
    return shipped("examples") / name / MISSION
