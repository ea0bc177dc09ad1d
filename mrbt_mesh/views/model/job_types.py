"""The job types of a mission, for forms and for programs."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission


@dataclass(frozen=True)
class ParameterView:
    """A parameter: one of `choices`, or if there are none a whole number from `min` to `max`."""

    name: str
    choices: tuple[str, ...]
    min: int | None
    max: int | None


@dataclass(frozen=True)
class JobTypeView:
    """A type of jobs, with what a job has unless it is submitted with something else.

    `deadline_s`: after how long it expires; None: never.
    """

    name: str
    parameters: tuple[ParameterView, ...]
    priority: int
    deadline_s: float | None


def job_types(mission: Mission) -> list[JobTypeView]:
    """Return all types, by name."""
    found = []
    for name, kind in sorted(mission.jobs.items()):
        parameters = tuple(
            ParameterView(p.name, p.choices, *((None, None) if p.choices else (p.low, p.high)))
            for p in kind.parameters
        )
        deadline_s = kind.deadline_us / SECOND_US if kind.deadline_us else None
        found.append(JobTypeView(name, parameters, kind.priority, deadline_s))
    return found


def submit_example(kind: JobTypeView) -> str:
    """Return a command that submits a job of this type."""
    words = [p.choices[0] if p.choices else str(p.min) for p in kind.parameters]
    return shlex.join(["mrbt", "submit", kind.name, *words])


def arguments_schema(kind: JobTypeView) -> dict[str, Any]:
    """Return the JSON Schema of a type's arguments, by parameter name."""
    return {
        "type": "object",
        "properties": {each.name: _schema(each) for each in kind.parameters},
        "required": [each.name for each in kind.parameters],
        "additionalProperties": False,
    }


def _schema(parameter: ParameterView) -> dict[str, Any]:
    if parameter.choices:
        return {"enum": list(parameter.choices)}
    return {"type": "integer", "minimum": parameter.min, "maximum": parameter.max}
