"""Load a robot program from a user's Python file."""

from __future__ import annotations

import difflib
import hashlib
import importlib.util
import re
import sys
import traceback
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.runtime.program import ProgramError, RobotProgram

DEFAULT_NAME = "robot"
_REFERENCE = re.compile(r"(.+\.py)(?::([A-Za-z_][A-Za-z0-9_]*))?", re.DOTALL)


def load_program(reference: str) -> RobotProgram:
    """The program in `path/to/file.py` or `path/to/file.py:name`; the name is `robot` by default.

    The file's folder stays on `sys.path`, so that it may import its neighbours, also later.
    Raises ProgramError that says what would be right, with the line where the file itself fails.
    """
    match = _REFERENCE.fullmatch(reference)
    if match is None:
        raise ProgramError(f"{reference!r}: expected a Python file, e.g. robot.py or robot.py:name")
    path, name = Path(match[1]).absolute(), match[2] or DEFAULT_NAME
    if not path.exists():
        raise ProgramError(f"{path}: there is no such file")
    if not path.is_file():
        raise ProgramError(f"{path}: not a file; give the Python file itself")
    return _pick(_import_file(path), path, name)


def check_program(
    program: RobotProgram, mission: Mission, capabilities: Iterable[str]
) -> list[str]:
    """What `program` lacks for these `capabilities` (types or ground): `local task weld`, and
    `bid for weld` where the mission asks for bids; sorted. Of a local task that is a tree, its
    actions: `local task grasp (in the tree of weld)`; of one in a BehaviorTree.CPP file what its
    leaves lack, with file, line and node.
    """
    claimed = {type_name(capability) for capability in capabilities}
    declared = claimed & mission.local_tasks.keys()
    needs = [need for task in mission.global_tasks.values() for need in task.needs]
    by_bid = claimed & {type_name(need.local_task) for need in needs if need.by_bid}
    trees: dict[str, set[str]] = {}
    for ground, tree in mission.local_trees.items():
        leaves = trees.setdefault(type_name(ground), set())
        leaves |= {type_name(node.subject) for node in tree.actions()}
    programs = {type_name(ground): tree for ground, tree in mission.program_trees.items()}
    needed = dict.fromkeys(declared - trees.keys() - programs.keys(), "")
    for name in sorted(declared & trees.keys()):
        for leaf in trees[name]:
            needed.setdefault(leaf, f" (in the tree of {name})")
    lacking = [f"local task {name}{of}" for name, of in needed.items() if not program.find(name)]
    for name in sorted(declared & programs.keys()):
        from mrbt_mesh.runtime.team_leaves import team_leaves
        from mrbt_mesh.runtime.tree_programs import lacking_leaves

        known = team_leaves(program.leaves, mission.conditions)
        problems = lacking_leaves(programs[name], known)
        lacking += [f"tree of {name} ({problem})" for problem in problems]
    return sorted(lacking + [f"bid for {name}" for name in by_bid if not program.find_bid(name)])


def _import_file(path: Path) -> ModuleType:
    folder = str(path.parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    # Two robots' files may both be called robot.py.
    suffix = hashlib.sha256(str(path).encode()).hexdigest()[:12]
    spec = importlib.util.spec_from_file_location(f"mrbt_program_{path.stem}_{suffix}", path)
    if spec is None or spec.loader is None:
        raise ProgramError(f"{path}: cannot be imported as Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        sys.modules.pop(spec.name, None)
        raise ProgramError(_import_failure(path, error)) from error
    return module


def _import_failure(path: Path, error: BaseException) -> str:
    if isinstance(error, SyntaxError):
        return f"{error.filename or path}:{error.lineno or 0}: not valid Python: {error.msg}"
    if isinstance(error, OSError) and error.filename == str(path):
        return f"{path}: cannot be read: {error.strerror}"
    if isinstance(error, SystemExit):
        said = "calls sys.exit() while it is imported; only define the program there"
    else:
        said = f"{type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame.lineno for frame in frames if frame.filename == str(path)]
    place = f"{path}:{own[-1]}" if own else str(path)
    return f"{place}: {said}"


def _pick(module: ModuleType, path: Path, name: str) -> RobotProgram:
    programs = [key for key, value in vars(module).items() if isinstance(value, RobotProgram)]
    if name not in vars(module):
        if programs:
            close = difflib.get_close_matches(name, programs, n=1) or programs
            hint = f"it defines {', '.join(programs)}; write {path.name}:{close[0]}"
        else:
            hint = f"write `{name} = RobotProgram()` in it"
        raise ProgramError(f"{path}: has no {name!r}; {hint}")
    program = getattr(module, name)
    if not isinstance(program, RobotProgram):
        kind = type(program).__name__
        raise ProgramError(f"{path}: {name!r} is a {kind}, a RobotProgram is expected")
    return program
