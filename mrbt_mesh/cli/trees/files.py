"""Trees in files: BehaviorTree.CPP's XML, or a mission."""

from __future__ import annotations

import os
from pathlib import Path

from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.errors import InputError

MISSION_SUFFIXES = (".yaml", ".yml", ".json")


def is_mission(path: Path) -> bool:
    """Whether a file is a mission, by its name; raises InputError if it can be no tree at all."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name one file in it")
    suffix = path.suffix.lower()
    if suffix not in (".xml", *MISSION_SUFFIXES):
        raise InputError(f"{path}: a tree is in a file that ends in .xml, .yaml, .yml or .json")
    return suffix != ".xml"


def package_folders() -> list[Path]:
    """Where ROS 2 has its packages, for <include ros_pkg>."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [Path(prefix) / "share" for prefix in prefixes if prefix]


def read_tree_file(
    path: Path, is_strict: bool = False, others: Library | None = None
) -> tuple[Library, Findings]:
    """A BehaviorTree.CPP file and what is wrong with it; trees and models of `others` are known.

    Raises FileError for a file that cannot be read at all.
    """
    return check_file(path, is_strict, package_folders(), others)
