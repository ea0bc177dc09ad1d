"""What commands ask of a mission before they begin: its robots, and a program that fits them."""

from __future__ import annotations

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.runtime.program import RobotProgram, functions_of
from mrbt_mesh.runtime.program_loader import load_program, require_program


def chosen_robots(option: str, text: str | None, mission: Mission) -> list[str]:
    """The robots of `--robots A1,B1`, or all of the mission, sorted; raises InputError."""
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
    """The robots' program, which must have what they can do, on a computer that has what it needs.

    Raises InputError.
    """
    reference = program or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one with --program")
    functions_of(fitting_program(mission, robots, reference)).check_computer()
    return reference


def fitting_program(mission: Mission, robots: list[str], reference: str) -> RobotProgram:
    """The program, which must have what these robots can do; raises ProgramError."""
    loaded = load_program(reference)
    capabilities = {name: mission.robots[name].capabilities for name in robots}
    require_program(loaded, reference, mission, capabilities)
    return loaded
