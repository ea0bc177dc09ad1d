"""`failure_reason` of a condition of a mission file: the task that it names is looked up."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.failure_reasons import (
    CONTAINS,
    EQUALS,
    GLOBAL,
    LOCAL,
    FailureReason,
    one_line,
)
from mrbt_mesh.formats.expand import Scope, argument_text, check_call, split_template, substitute
from mrbt_mesh.formats.mission_model import ConditionModel, FailureReasonModel, MissionModel
from mrbt_mesh.formats.problems import Report, SourcePath

_PARAMETER = re.compile(r"\$[A-Za-z_][A-Za-z0-9_]*")


def condition_types(model: MissionModel, report: Report) -> dict[str, ConditionType]:
    """The team's conditions; what is wrong with their failure reasons goes to the report."""
    reader = _Reader(model, report)
    return {
        name: ConditionType(
            name,
            tuple(each.parameters),
            each.default,
            each.per == "robot",
            None if each.failure_reason is None else reader.read(name, each, each.failure_reason),
        )
        for name, each in sorted(model.conditions.items())
    }


def local_condition_types(model: MissionModel, report: Report) -> dict[str, ConditionType]:
    """The conditions of robots' own, which their programs set."""
    for name, each in model.local_conditions.items():
        if each.failure_reason is not None:
            place = ("local_conditions", name, "failure_reason")
            report.add(place, "only the team's conditions tell why something failed")
    return {
        name: ConditionType(name, tuple(each.parameters), each.default, each.per == "robot")
        for name, each in sorted(model.local_conditions.items())
    }


class _Reader:
    def __init__(self, model: MissionModel, report: Report) -> None:
        self._globals: Scope = model.parameters
        self._report = report
        self._tables: dict[str, tuple[str, Mapping[str, Sequence[str]]]] = {
            GLOBAL: ("global task", {n: t.parameters for n, t in model.global_tasks.items()}),
            LOCAL: ("local task", {n: t.parameters for n, t in model.local_tasks.items()}),
        }

    def read(
        self, name: str, condition: ConditionModel, model: FailureReasonModel
    ) -> FailureReason | None:
        place: SourcePath = ("conditions", name, "failure_reason")
        if condition.default:
            self._report.add(
                ("conditions", name, "default"),
                "a condition that tells why something failed is false at first",
            )
        kind = GLOBAL if model.global_task is not None else LOCAL
        call = model.global_task or model.local_task or ""
        match, text = (EQUALS, model.equals) if model.equals else (CONTAINS, model.contains)
        text = text or ""
        if one_line(text) != text:
            problem = "reasons are one line, without spaces around and with single ones inside"
            self._report.add((*place, match), problem)
        what, table = self._tables[kind]
        parameters = frozenset(condition.parameters)
        lists = {task: list(names) for task, names in table.items()}
        scope = parameters | frozenset(self._globals)
        check_call(call, what, lists, scope, (*place, kind), self._report)
        task, templates = split_template(call)
        for parameter in condition.parameters:
            if f"${parameter}" not in templates:
                problem = f"${parameter} is no argument of {call}: nothing would say which it is"
                self._report.add((*place, kind), problem)
        try:
            arguments = tuple(self._argument(each, parameters) for each in templates)
        except (KeyError, ValueError) as error:
            if isinstance(error, ValueError):
                self._report.add((*place, kind), str(error))
            return None
        return FailureReason(kind, task, arguments, match, text)

    def _argument(self, template: str, parameters: frozenset[str]) -> str:
        """`$name` of the condition stays; those of the mission are filled in."""
        if _PARAMETER.fullmatch(template) and template[1:] in parameters:
            return template
        if any(found[1:] in parameters for found in _PARAMETER.findall(template)):
            raise ValueError(f"{template}: a parameter of the condition stands alone here")
        return argument_text(substitute(template, self._globals))
