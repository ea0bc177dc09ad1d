"""What commands ask of a mission before they begin: its robots, and a program that fits them."""

from __future__ import annotations

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.program_loader import check_program, load_program


def chosen_robots(option: str, text: str | None, mission: Mission) -> list[str]:
    """The robots of `--robots A1,B1`, or all of the mission, sorted; raises InputError."""
    if text is None:
        return sorted(mission.robots)
    names = [name.strip() for name in text.split(",")]
    unknown = [name for name in names if name not in mission.robots]
    if unknown:
        listed = ", ".join(sorted(mission.robots))
        named = ", ".join(name or "''" for name in unknown)
        where = f"mission {mission.name} has no robot {named} ({listed})"
        raise InputError(f"{option} {text}: {where}")
    if len(set(names)) < len(names):
        raise InputError(f"{option} {text}: a robot is named twice")
    return sorted(names)


def checked_program(mission: Mission, robots: list[str], program: str | None) -> str:
    """The robots' program, which must have what they can do; raises InputError."""
    reference = program or mission.program
    if reference is None:
        raise InputError(f"mission {mission.name} names no program: give one with --program")
    loaded = load_program(reference)
    for robot in robots:
        lacking = check_program(loaded, mission, mission.robots[robot].capabilities)
        if lacking:
            raise InputError(f"{reference}: robot {robot} needs {', '.join(lacking)}")
    return reference
