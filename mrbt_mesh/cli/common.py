"""What all commands share: exit statuses, errors as messages, the run directory option."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from mrbt_mesh.core.assignment.problem import SolverError
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.btcpp.check import check_file
from mrbt_mesh.formats.btcpp.findings import Findings
from mrbt_mesh.formats.btcpp.library import Library
from mrbt_mesh.formats.mission_file import MissionError, load_mission
from mrbt_mesh.formats.shipped import UnknownExampleError
from mrbt_mesh.runtime.program import ProgramError
from mrbt_mesh.runtime.program_loader import check_program, load_program
from mrbt_mesh.runtime.run_dir import RunDirError
from mrbt_mesh.runtime.team_address import AddressError
from mrbt_mesh.runtime.zenoh_transport import TransportError

SUCCESS, FAILURE, BAD_INPUT, NOT_FINISHED = 0, 1, 2, 3
EXIT_OF_RESULT = {
    "success": SUCCESS,
    "failure": FAILURE,
    "timeout": NOT_FINISHED,
    "blocked": NOT_FINISHED,
    "not_started": NOT_FINISHED,
}

console = Console()
errors = Console(stderr=True, highlight=False)

MissionArgument = Annotated[Path, typer.Argument(help="Mission file (.yaml).", metavar="MISSION")]
RunDirOption = Annotated[
    Path | None,
    typer.Option("--run-dir", help="Run directory. Default: the run started last."),
]
RobotsOption = Annotated[
    str | None, typer.Option("--robots", help="Only these robots, A1,A2. Default: all.")
]
SolverOption = Annotated[
    str | None,
    typer.Option(
        "--solver",
        metavar="NAME",
        help="min_cost_flow, cp_sat, brute_force, or your own: docs/solvers.md. "
        "Default: the mission's.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]


class InputError(Exception):
    """Bad input from the command line; the message says what would be right."""


def fail(message: str, code: int = BAD_INPUT) -> NoReturn:
    """Print a message for people on stderr and end with an exit status."""
    errors.print(f"[bold red]error:[/] {_escape(message)}", soft_wrap=True)
    raise typer.Exit(code)


def _escape(text: str) -> str:
    return text.replace("[", r"\[")


@contextlib.contextmanager
def input_errors() -> Iterator[None]:
    """Turn every kind of bad input into a message and exit status 2."""
    try:
        yield
    except (
        MissionError,
        ProgramError,
        RunDirError,
        AddressError,
        TransportError,
        InputError,
        SolverError,
        UnknownExampleError,
    ) as error:
        fail(str(error))


def read_mission(path: Path) -> Mission:
    """Load a mission, or end with exit status 2 and the list of its problems."""
    with input_errors():
        return load_mission(path)


def read_tree_file(path: Path, is_strict: bool = False) -> tuple[Library, Findings]:
    """A BehaviorTree.CPP file and what is wrong with it; packages are sought where ROS 2 has them.

    Raises TreeFileError for a file that cannot be read at all.
    """
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders = [Path(prefix) / "share" for prefix in prefixes if prefix]
    return check_file(path, is_strict, folders)


def print_json(data: Any) -> None:
    """One JSON document on stdout, as it is: no colours, no wrapping."""
    sys.stdout.write(json.dumps(data, indent=2) + "\n")


def bar_of_runs(*fields: str) -> Progress:
    """Many runs on their way, on stderr; it vanishes at the end.

    `fields` are texts of the bar's task besides how many are done, e.g. `{task.fields[rate]}`.
    """
    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        *map(TextColumn, fields),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=errors,
        transient=True,
    )


def end_process(code: int) -> NoReturn:
    """End a process that had a Zenoh session: closing one can take 10 s, so do not wait."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def chosen_robots(text: str | None, mission: Mission) -> list[str]:
    """The robots of `--robots A1,B1`, or all of the mission, sorted; raises InputError."""
    if text is None:
        return sorted(mission.robots)
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in mission.robots]
    if unknown or not names:
        listed = ", ".join(sorted(mission.robots))
        raise InputError(f"mission {mission.name} has no robot {', '.join(unknown)} ({listed})")
    if len(set(names)) < len(names):
        raise InputError(f"--robots {text}: a robot is named twice")
    return sorted(names)


def checked_program(mission: Mission, robots: list[str], program: str | None) -> str:
    """The robots' program, which must have what they can do; raises InputError, ProgramError."""
    reference = program or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one with --program")
    loaded = load_program(reference)
    for robot in robots:
        lacking = check_program(loaded, mission, mission.robots[robot].capabilities)
        if lacking:
            raise InputError(f"{reference}: robot {robot} needs {', '.join(lacking)}")
    return reference
