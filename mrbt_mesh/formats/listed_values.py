"""The values of a list in a mission file, or of a parameter that is a list."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.mission.mission import MAX_CHOICES
from mrbt_mesh.formats.expand import argument_text, check_references
from mrbt_mesh.formats.mission_model import MissionModel
from mrbt_mesh.formats.problems import Report, SourcePath, found


def listed_values(
    given: Any, model: MissionModel, path: SourcePath, report: Report
) -> tuple[str, ...]:
    """Return the values as arguments; problems go to the report.

    `given` is a list, or `$name` of a parameter that is one.
    """
    choices: dict[str, None] = {}
    for value, place in _listed(given, model, path, report):
        try:
            text = argument_text(value)
        except ValueError as error:
            report.add(place, str(error))
            continue
        if text in choices:
            report.add(place, f"{text} is given twice; keep one")
        choices[text] = None
    return tuple(choices)


def _listed(
    given: Any, model: MissionModel, path: SourcePath, report: Report
) -> list[tuple[Any, SourcePath]]:
    """Return each value with its place."""
    if not isinstance(given, str):
        return [(value, (*path, i)) for i, value in enumerate(given)]
    values = model.parameters.get(given[1:])
    check_references(given, frozenset(model.parameters), path, report)
    if given[1:] not in model.parameters:
        return []
    if not isinstance(values, list) or not 0 < len(values) <= MAX_CHOICES:
        message = f"a list of 1 to {MAX_CHOICES} values is expected, but {given} is"
        shown = f"{len(values)} values" if isinstance(values, list) else found(values)
        report.add(path, f"{message} {shown}")
        return []
    return [(value, path) for value in values]
