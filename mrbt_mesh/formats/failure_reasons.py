"""Read `failure_reason` of the conditions in a mission file, and look up the task it names."""

from __future__ import annotations

import re

from mrbt_mesh.core.mission.conditions import ConditionType, EntryTraits
from mrbt_mesh.core.mission.failure_reasons import (
    CONTAINS,
    EQUALS,
    GLOBAL,
    LOCAL,
    FailureReason,
    one_line,
)
from mrbt_mesh.formats.expand import Scope, argument_text, check_call, split_template, substitute
from mrbt_mesh.formats.mission_model import ConditionModel, MissionModel
from mrbt_mesh.formats.problems import Report, SourcePath

_PARAMETER = re.compile(r"\$[A-Za-z_][A-Za-z0-9_]*")


def condition_types(model: MissionModel, report: Report) -> dict[str, ConditionType]:
    """Return the team's conditions; problems go to the report."""
    return {
        name: ConditionType(
            name,
            tuple(each.parameters),
            each.default,
            _reason(model, name, each, report),
            _of_each_robot() if each.per == "robot" else None,
        )
        for name, each in sorted(model.conditions.items())
    }


def _of_each_robot() -> EntryTraits:
    # Loaded only for missions with such conditions.
    from mrbt_mesh.features.values.traits import Traits

    return Traits(per_robot=True)


def _reason(
    model: MissionModel, name: str, condition: ConditionModel, report: Report
) -> FailureReason | None:
    given = condition.failure_reason
    if given is None:
        return None
    place: SourcePath = ("conditions", name, "failure_reason")
    if condition.default:
        message = "a condition that follows from a failure is false at first"
        report.add(("conditions", name, "default"), message)
    kind, tasks = (
        (LOCAL, model.local_tasks) if given.global_task is None else (GLOBAL, model.global_tasks)
    )
    call = given.global_task or given.local_task or ""
    match, text = (EQUALS, given.equals) if given.equals else (CONTAINS, given.contains or "")
    if one_line(text) != text:
        problem = "reasons are one line, without spaces around and with single ones inside"
        report.add((*place, match), problem)
    place = (*place, kind)
    own = frozenset(condition.parameters)
    parameters = {task: entry.parameters for task, entry in tasks.items()}
    scope = own | frozenset(model.parameters)
    check_call(call, kind.replace("_", " "), parameters, scope, place, report)
    task, templates = split_template(call)
    for parameter in condition.parameters:
        if f"${parameter}" not in templates:
            report.add(place, f"${parameter} is not an argument of {call}; it has to be one")
    try:
        arguments = tuple(_argument(each, own, model.parameters) for each in templates)
    except KeyError:
        return None  # `check_call` has reported it
    except ValueError as error:
        report.add(place, str(error))
        return None
    return FailureReason(kind, task, arguments, match, text)


def _argument(template: str, own: frozenset[str], parameters: Scope) -> str:
    """Fill in parameters of the mission, but keep `$name` of the condition."""
    if _PARAMETER.fullmatch(template) and template[1:] in own:
        return template
    if any(found[1:] in own for found in _PARAMETER.findall(template)):
        raise ValueError(f"{template}: a parameter of the condition must be a whole argument here")
    return argument_text(substitute(template, parameters))
