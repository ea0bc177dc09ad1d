"""Read schedules that `mrbt sim chaos` wrote."""

from __future__ import annotations

import json
from pathlib import Path

from mrbt_mesh.cli.options import checked_program
from mrbt_mesh.cli.terminal import reason
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.world.scenario import Scenario, ScenarioError, scenario_from_json

# Fields of faults that name one robot, several robots, and both ends of links.
_ONE, _MANY, _LINKS = ("robot", "source", "seen_by"), ("robots",), ("links", "broken")


def read_schedule(
    path: Path, mission: Path | None, program: str | None
) -> tuple[Mission, RobotProgram, Scenario]:
    """Read a schedule file with its mission, which `mission` overrides.

    Raises InputError for everything that is wrong with the file.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(data, dict):
            raise ScenarioError("an object with mission, seed, robots, steps is expected")
        named, own = data.pop("mission", None), data.pop("program", None)
        scenario = scenario_from_json(data)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    except (ScenarioError, ValueError, RecursionError) as error:  # also errors of JSON and UTF-8
        raise InputError(f"{path}: no schedule as `mrbt sim chaos` writes them: {error}") from None
    if mission is None and not isinstance(named, str):
        raise InputError(f"{path}: names no mission; give one as the argument MISSION")
    model = load_mission(mission or path.parent / str(named))
    unknown = sorted(_robots(scenario) - model.robots.keys())
    if unknown:
        raise InputError(f"{path}: mission {model.name} has no robot {', '.join(unknown)}")
    reference = program or (own if mission is None and isinstance(own, str) else None)
    code = load_program(checked_program(model, sorted(model.robots), reference))
    return model, code, scenario


def _robots(scenario: Scenario) -> set[str]:
    """Return all robots that a scenario names."""
    found = set(scenario.robots)
    for _, fault in scenario.steps:
        found |= {getattr(fault, name) for name in _ONE if hasattr(fault, name)}
        found |= {robot for name in _MANY for robot in getattr(fault, name, None) or ()}
        found |= {
            end for name in _LINKS for link in getattr(fault, name, None) or () for end in link
        }
    return found
