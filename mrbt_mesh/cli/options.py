"""Options that several commands share, each defined once, and their meaning for a mission."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from mrbt_mesh.cli.command import PATH, Decorator, FiniteNumber, options_as, with_options
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.runtime.settings import DEFAULT_KEEP_MIB

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.runtime.program import RobotProgram

mission_argument = click.argument("mission", metavar="MISSION", type=PATH, help="Mission file.")
optional_mission_argument = click.argument(
    "mission", metavar="[MISSION]", type=PATH, required=False, help="Mission file."
)
robot_argument = click.argument("robot", metavar="ROBOT", help="A robot's id.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
run_dir_option = click.option(
    "--run-dir",
    type=PATH,
    metavar="DIR|TEAM",
    help="Run directory, or a name from `mrbt ls`. Default: the team that runs, or the newest run.",
)


@dataclass(frozen=True)
class ShowOptions:
    """How a run is shown: in a live view, as lines, or as one JSON object at the end."""

    headless: bool = False
    as_json: bool = False
    timeout: float | None = None


show_options = options_as(
    "show",
    ShowOptions,
    click.option("--headless", is_flag=True, help="Lines as things happen, no live view."),
    json_option,
    click.option(
        "--timeout", type=FiniteNumber(0), metavar="SECONDS", help="End after this many seconds."
    ),
)


# -- how a mission is run ---------------------------------------------------------------------

robots_option = click.option("--robots", metavar="A1,A2,...", help="Only these. Default: all.")
program_option = click.option(
    "--program", metavar="FILE.py[:NAME]", help="The robots' program. Default: the mission's."
)
solver_option = click.option(
    "--solver",
    metavar="NAME",
    help="min_cost_flow, cp_sat or MODULE:FUNCTION. Default: the mission's.",
)
speed_option = click.option(
    "--speed",
    type=FiniteNumber(0.01, 1000),
    default=1.0,
    help="Simulated robots work this many times faster.",
)
record_beats_option = click.option(
    "--record-beats", is_flag=True, help="Record every heartbeat as well."
)
keep_option = click.option(
    "--keep",
    "keep_mib",
    type=click.IntRange(1, 1_000_000),
    default=DEFAULT_KEEP_MIB,
    metavar="MIB",
    help="Size at which log files are rotated, and of all parts of a recording that are kept.",
)

# -- in virtual time --------------------------------------------------------------------------

seed_option = click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    metavar="N",
    help="The same seed gives the same result.",
)
virtual_timeout_option = click.option(
    "--timeout",
    type=FiniteNumber(0.001),
    default=600.0,
    metavar="SECONDS",
    help="Virtual seconds after which a run is ended.",
)
jobs_option = click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    metavar="N",
    default=os.cpu_count,
    show_default="all cores",
    help="Number of processes.",
)

# Each option with the form of its values, and its help.
FAULTS = {
    "kill": ("A1@12.5,...", "SIGKILL; give it several times, or with commas."),
    "restart": ("A1@14,...", "Start it again, or one more."),
    "freeze": ("A1@3,...", "SIGSTOP."),
    "thaw": ("A1@8,...", "SIGCONT."),
    "leave": ("B1@6,...", "Leave on purpose."),
    "fault": ("A1:LOCAL_TASK@4,...", "Lose a capability, or all of them."),
    "restore": ("A1[:LOCAL_TASK]@6,...", "Restore a capability."),
    "performance": ("A1:LOCAL_TASK=0.5@4,...", "Do it better or worse from then on."),
}


def fault_options(*names: str) -> Decorator:
    """Return an option for each of these kinds of faults; its values arrive under its name."""
    options = [
        click.option(f"--{name}", multiple=True, metavar=metavar, help=text)
        for name, (metavar, text) in FAULTS.items()
        if name in names
    ]
    return partial(with_options, options=options)


def comma_list(_: Any, __: Any, values: str | Iterable[str] | None) -> tuple[str, ...]:
    """Click callback: split `A,B`, also if the option is given several times, into one tuple."""
    texts = [values] if isinstance(values, str) else values or ()
    return tuple(part for text in texts if text for part in text.split(","))


def chosen_robots(option: str, text: str | None, mission: Mission) -> list[str]:
    """Return the robots of `--robots A1,B1`, or all of the mission, sorted; raises InputError."""
    if text is None:
        return sorted(mission.robots)
    names = [name.strip() for name in text.split(",")]
    unknown = [name for name in names if name not in mission.robots]
    if unknown:
        hint = nearest(unknown[0], mission.robots)
        problem = f"mission {mission.name} has no robot {unknown[0]!r}{hint}"
        raise InputError(f"{option} {text}: {problem}")
    if len(set(names)) < len(names):
        raise InputError(f"{option} {text}: a robot is named twice")
    return sorted(names)


def checked_program(mission: Mission, robots: list[str], program: str | None) -> str:
    """Return the robots' program, after checking it against the robots and this computer.

    Raises InputError if a local task is missing, or the computer does not meet its requirements.
    """
    from mrbt_mesh.runtime.program import functions_of

    reference = program or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one with --program")
    functions_of(fitting_program(mission, robots, reference)).check_computer()
    return reference


def fitting_program(mission: Mission, robots: list[str], reference: str) -> RobotProgram:
    """Load the program, which must have these robots' local tasks; raises ProgramError."""
    from mrbt_mesh.runtime.program_loader import load_program, require_program

    loaded = load_program(reference)
    capabilities = {name: mission.robots[name].capabilities for name in robots}
    require_program(loaded, reference, mission, capabilities)
    return loaded
