"""Reads all BehaviorTree.CPP files of a folder, for example of a robot's package."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from mrbt_mesh.btcpp.files.document import INCLUDE, MODELS, TREE, Document, read_document
from mrbt_mesh.errors import FileError, InputError

MAX_FOLDER_FILES = 5_000
_OF_A_TREE = frozenset({TREE, MODELS, INCLUDE})


@dataclass
class TreeFolder:
    """Contents of a folder: documents by file, unreadable files, and XML files of other kinds."""

    path: Path
    documents: dict[Path, Document] = field(default_factory=dict)
    unreadable: dict[Path, FileError] = field(default_factory=dict)
    skipped: list[Path] = field(default_factory=list)


def read_folder(folder: Path) -> TreeFolder:
    """Read all .xml files below a folder, sorted by name, except those in hidden folders.

    Raises InputError if there are no BehaviorTree.CPP files, or more than MAX_FOLDER_FILES files.
    """
    found = TreeFolder(folder)
    paths = _xml_files(folder)
    for path in paths:
        try:
            document = read_document(path)
        except FileError as error:
            if _speaks_of_trees(path):
                found.unreadable[path] = error
            else:
                found.skipped.append(path)
            continue
        is_tree = any(child.tag in _OF_A_TREE for child in document.root.children)
        if is_tree or "BTCPP_format" in document.root.attributes:
            found.documents[path] = document
        else:
            found.skipped.append(path)
    if not found.documents and not found.unreadable:
        raise InputError(f"{folder}: no BehaviorTree.CPP file (.xml) in this folder")
    return found


def _xml_files(folder: Path) -> list[Path]:
    paths: list[Path] = []
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        paths += (Path(place) / name for name in sorted(files) if name.lower().endswith(".xml"))
        if len(paths) > MAX_FOLDER_FILES:
            raise InputError(f"{folder}: more than {MAX_FOLDER_FILES} XML files")
    return paths


def _speaks_of_trees(path: Path) -> bool:
    """Return whether an unreadable file was probably meant to contain trees."""
    try:
        with path.open("rb") as file:
            content = file.read(1 << 20).replace(b"\0", b"")
    except OSError:
        return True
    return b"<BehaviorTree" in content
