"""Load a robot program from a user's Python file."""

from __future__ import annotations

import difflib
import hashlib
import importlib.util
import os
import re
import sys
import traceback
from collections.abc import Collection, Iterable, Mapping
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import TypeAlias

from mrbt_mesh.core.mission.jobs import with_one_of_each
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import ALL, entries_in, split_call, type_name, with_entries
from mrbt_mesh.errors import FileError, InputError, nearest
from mrbt_mesh.plugins import tree_format
from mrbt_mesh.runtime.program import RobotProgram, functions_of
from mrbt_mesh.runtime.program_function import BackgroundFunction, ProgramError, ProgramFunction

DEFAULT_NAME = "robot"
_REFERENCE = re.compile(r"(.+\.py)(?::([A-Za-z_][A-Za-z0-9_]*))?", re.DOTALL)


def load_program(reference: str) -> RobotProgram:
    """Load the program in `path/to/file.py` or `path/to/file.py:name`; the default name is `robot`.

    The file's folder stays on `sys.path`, so that the file can import its neighbours, even later.
    Raises ProgramError with the remedy, and with the line if the file itself fails.
    """
    path, name = program_file(reference)
    return _pick(_import_file(path), path, name)


def program_file(reference: str) -> tuple[Path, str]:
    """Return a program's file, and its name in the file.

    Raises ProgramError if there is no such file.
    """
    match = _REFERENCE.fullmatch(reference)
    if match is None:
        raise ProgramError(f"{reference!r}: expected a Python file, e.g. robot.py or robot.py:name")
    path, name = Path(match[1]).absolute(), match[2] or DEFAULT_NAME
    if not path.exists():
        text = "there is no such file; the mission's `program`, or --program, names it"
        raise ProgramError(f"{path}: {text}")
    if not path.is_file():
        raise ProgramError(f"{path}: not a file; give the Python file itself")
    return path, name


def require_program(
    program: RobotProgram,
    reference: str,
    mission: Mission,
    robots: Mapping[str, Iterable[str]],
) -> None:
    """Check a program, found at `reference`, for these robots' capabilities (types or ground).

    Raises ProgramError if it lacks what they need, or has a function that cannot be called as the
    mission calls it, and InputError from the program's own checks.
    `ProgramFunctions.check_computer` checks what the computer lacks.
    """
    for check in functions_of(program).mission_checks:
        check(mission, robots.keys())
    found: dict[str, list[str]] = {}
    for robot, capabilities in sorted(robots.items()):
        for problem in check_program(program, mission, capabilities):
            found.setdefault(problem, []).append(robot)
    if found:
        path = reference.rpartition(":")[0] if ".py:" in reference else reference
        raise ProgramError(
            "\n".join(
                text if os.path.isabs(text) else f"{path}: {text} (robots: {', '.join(names)})"
                for text, names in found.items()
            )
        )


def check_program(
    program: RobotProgram, mission: Mission, capabilities: Iterable[str]
) -> list[str]:
    """Return what is wrong with `program` for these `capabilities` (types or ground), sorted.

    Reported are a local task without a function, or without a bid function if the mission asks for
    bids; for a local task that is a tree, what its leaves lack, with file, line and node; and a
    function that does not accept the mission's arguments, with its place.
    """
    mission = with_one_of_each(mission)
    claimed = {type_name(capability) for capability in capabilities}
    declared = claimed & mission.local_tasks.keys()
    needs = [need for task in mission.global_tasks.values() for need in task.needs]
    programs = {type_name(ground): tree for ground, tree in mission.program_trees.items()}
    grounds = {need.local_task for need in needs if type_name(need.local_task) in declared}
    calls = {name for name in declared | grounds if type_name(name) not in programs}
    found = [_task_problem(program, mission, ground) for ground in sorted(calls)]
    # Bids are the only rule.
    bid_for = {need.local_task for need in needs if need.performance_rule}
    found += [_bid_problem(program, mission, each, each in bid_for) for each in sorted(grounds)]
    known = claimed | mission.local_tasks.keys()
    found += [_costs_problem(each, known) for each in functions_of(program).backgrounds]
    # One problem per function, however many calls it does not fit.
    problems = set({place: problem for place, problem in reversed(found) if problem}.values())
    for name in sorted(declared & programs.keys()):
        file = programs[name]
        registry = functions_of(program).leaves
        lacking = tree_format(file.source).problems(file, registry, mission.conditions)
        problems |= {f"tree of {name} ({each})" for each in lacking}
    return sorted(problems)


# The place of a problem and its text; both are empty if there is none.
_Problem: TypeAlias = tuple[str, str]


def _task_problem(program: RobotProgram, mission: Mission, ground: str) -> _Problem:
    name = type_name(ground)
    functions = functions_of(program)
    function = functions.local_task(name)
    if function is None:
        close = difflib.get_close_matches(name, functions.local_tasks, n=1)
        hint = f"rename {close[0]!r}, or add" if close else "add"
        add = f'{hint} @robot.local_task("{name}")'
        return name, f"no function for the local task {name}; {add}"
    return _call_problem(function, mission, ground)


def _bid_problem(program: RobotProgram, mission: Mission, ground: str, is_needed: bool) -> _Problem:
    name = type_name(ground)
    function = functions_of(program).bid(name)
    if function is None:
        text = f'no bid for the local task {name}; add @robot.bid("{name}")'
        return (f"bid {name}", text) if is_needed else ("", "")
    return _call_problem(function, mission, ground)


def _costs_problem(background: BackgroundFunction, known: Collection[str]) -> _Problem:
    for name in background.costs:
        if name != ALL and type_name(name) not in known:
            hint = nearest(type_name(name), known)
            what = f"background function {background.name!r}: costs names {name!r}"
            return what, f"{what}, which is not a local task of the mission{hint}"
    return "", ""


def _call_problem(function: ProgramFunction, mission: Mission, ground: str) -> _Problem:
    """Return why the function cannot be called for a ground local task, or for a type of local
    tasks.
    """
    declared = mission.local_tasks.get(type_name(ground))
    if declared is not None:
        parameters = ", ".join(declared.parameters)
        problem = function.count_problem(len(declared.parameters))
        if problem:
            where = f"the mission declares {declared.name}({parameters})"
            return function.place, f"{function.place}: {function.what}: {problem}, but {where}"
        if "(" not in ground and declared.parameters:
            return "", ""
    samples = {name: mission.entries.samples(name) for name in entries_in(ground)}
    samples = {name: texts for name, texts in samples.items() if texts}
    try:
        for number in range(max(map(len, samples.values()), default=1)):
            values = {name: texts[number % len(texts)] for name, texts in samples.items()}
            function.values(split_call(with_entries(ground, values))[1])
    except ValueError as error:
        problem = f"{function.what}: {error}, in {ground} of the mission"
        return function.place, f"{function.place}: {problem}"
    return "", ""


def _import_file(path: Path) -> ModuleType:
    folder = str(path.parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    # The files of two robots may both be called robot.py.
    suffix = hashlib.sha256(os.fsencode(path)).hexdigest()[:12]
    spec = importlib.util.spec_from_file_location(f"mrbt_program_{path.stem}_{suffix}", path)
    if spec is None or spec.loader is None:
        raise ProgramError(f"{path}: cannot be imported as Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        # What the program prints must not mix with a command's output.
        with redirect_stdout(sys.stderr):
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        sys.modules.pop(spec.name, None)
        raise ProgramError(_import_failure(path, error)) from error
    return module


def _import_failure(path: Path, error: BaseException) -> str:
    if isinstance(error, FileError):
        return str(error)  # from a file of bindings, with its own places
    if isinstance(error, SyntaxError):
        line = f":{error.lineno}" if error.lineno else ""
        return f"{error.filename or path}{line}: not valid Python: {error.msg}"
    if isinstance(error, OSError) and error.filename == str(path):
        return f"{path}: cannot be read: {error.strerror}"
    if isinstance(error, SystemExit):
        said = "calls sys.exit() while it is imported; only define the program there"
    elif isinstance(error, InputError):
        said = str(error)
    elif isinstance(error, ModuleNotFoundError):
        said = f"{error.msg}; install it, or correct the import"
    elif isinstance(error, ImportError):
        said = f"{error.msg}; correct the import"
    else:
        said = f"{type(error).__name__}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    # The program's own line, or the line of a neighbour that it imports.
    own = [frame for frame in frames if Path(frame.filename).parent == path.parent]
    if isinstance(error, ValueError) and not own:
        # No code of it has run: before Python 3.11.4, null bytes are refused like this too.
        return f"{path}: not valid Python: {error}"
    place = f"{own[-1].filename}:{own[-1].lineno}" if own else str(path)
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
