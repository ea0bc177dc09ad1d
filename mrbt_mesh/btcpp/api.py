"""Trees by file name: load, check and run them. `mrbt_mesh.btcpp` exports these functions."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import anyio

from mrbt_mesh.btcpp.executor.leaves import Leaves
from mrbt_mesh.btcpp.executor.node import NodeStatus
from mrbt_mesh.btcpp.executor.tree import BehaviorTree
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.findings import Finding
from mrbt_mesh.errors import whole_file_error

load = BehaviorTree.from_file


def check(
    file: Path | str, *, is_strict: bool = False, package_folders: Sequence[Path] = ()
) -> list[Finding]:
    """Check a file and all files it includes; returns errors and warnings in file order.

    With `is_strict`, everything that BehaviorTree.CPP refuses is an error. `package_folders` are
    searched for the packages that `ros_pkg` of an <include> names. Raises FileError if the file
    cannot be read as XML with a <root>.
    """
    return check_file(Path(file), is_strict, package_folders)[1].in_order()


def run(
    file: Path | str,
    program: Leaves | Path | str,
    *,
    tree: str | None = None,
    entries: Mapping[str, Any] | None = None,
    warn: Callable[[Finding], object] | None = None,
) -> NodeStatus:
    """Run a tree to its end in an event loop of its own; returns SUCCESS, FAILURE or SKIPPED.

    `program`: the leaves, or a Python file that defines them (see `load_leaves`). `tree`: an ID,
    by default the main tree. `entries`: initial values of entries of its blackboard. `warn` is
    called with each warning about the file before the tree starts. Raises FileError,
    BlackboardError, TickError, and any error of a leaf except TaskFailedError.
    """
    leaves = program if isinstance(program, Leaves) else load_leaves(program)
    loaded = load(file, tree, leaves)
    loaded.check()
    if warn is not None:
        for warning in loaded.warnings:
            warn(warning)
    for name, value in (entries or {}).items():
        loaded.blackboard[name] = value
    return anyio.run(loaded.run)


def load_leaves(program: Path | str) -> Leaves:
    """Run a Python file and return the Leaves object that it defines.

    The file may import modules from its own folder, which is put first in `sys.path`. Raises
    FileError if it cannot be run, or if it does not define exactly one `Leaves` object.
    """
    folder = str(Path(program).resolve().parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        defined = runpy.run_path(str(program), run_name=Path(program).stem).values()
    except OSError as error:
        raise whole_file_error(str(program), f"cannot be read: {error.strerror}") from error
    except Exception as error:
        raise whole_file_error(str(program), f"{type(error).__name__}: {error}") from error
    found = {id(value): value for value in defined if isinstance(value, Leaves)}
    if len(found) != 1:
        message = f"exactly one Leaves() object is expected in it, found {len(found) or 'none'}"
        raise whole_file_error(str(program), message)
    return next(iter(found.values()))
