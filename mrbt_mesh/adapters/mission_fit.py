"""Whether a file that binds local tasks to something else fits a mission."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.problems import Report, SourcePath


def note_misfits(
    report: Report,
    mission: Mission,
    tasks: Mapping[str, Sequence[str]],
    conditions: Iterable[tuple[SourcePath, str]],
) -> None:
    """Report local tasks with other numbers of parameters, and conditions that are not declared.

    `tasks`: the parameters of the file's `local_tasks`; those that the mission lacks do not matter,
    since a file may serve several missions.
    """
    for name, parameters in tasks.items():
        declared = mission.local_tasks.get(name)
        if declared is not None and len(declared.parameters) != len(parameters):
            own, wanted = (", ".join(each) for each in (parameters, declared.parameters))
            text = f"the parameters are [{own}], but the mission declares {name}({wanted})"
            report.add(("local_tasks", name, "parameters"), text)
    for place, condition in conditions:
        name = type_name(condition)
        if name not in mission.conditions:
            hint = nearest(name, mission.conditions)
            report.add(place, f"mission {mission.name} has no condition {name!r}{hint}")


def note_missing_robots(
    report: Report, key: str, known: Collection[str], robots: Iterable[str]
) -> None:
    """Report robots of the mission that the mapping at `key` of the file does not have."""
    for robot in sorted(set(robots) - set(known)):
        report.add((key,), f"the mission's robot {robot} is missing here")
