"""Build side constraints from a mission file, and look up what they name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from mrbt_mesh.core.feature import Built
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.errors import nearest
from mrbt_mesh.features.constraints.file_fields import ConstraintsModel
from mrbt_mesh.features.constraints.kinds import (
    SECTION,
    AtMost,
    Constraint,
    NeverTogether,
    NotAtOnce,
)
from mrbt_mesh.formats.expand import call_text, split_template
from mrbt_mesh.formats.jobs import may_request
from mrbt_mesh.formats.mission_model import MissionModel
from mrbt_mesh.formats.problems import Report, SourcePath


def build(model: MissionModel, built: Built, report: Report) -> tuple[Constraint, ...]:
    """Return the constraints, with the names that they use looked up; problems go to the report."""
    given: ConstraintsModel = getattr(model, SECTION)
    known_robots, known_tasks = set(model.robots), _global_names(given, built)
    result: list[Constraint] = []
    for i, together in enumerate(given.never_together):
        here: SourcePath = (SECTION, "never_together", i)
        names = _local_names(
            together.local_tasks, (*here, "local_tasks"), built.local_tasks, report
        )
        who = _names(together.robots, (*here, "robots"), report, "no robot", known_robots)
        result.append(NeverTogether(who, names))
    for i, most in enumerate(given.at_most):
        here = (SECTION, "at_most", i)
        who = _names(most.robots, (*here, "robots"), report, "no robot", known_robots)
        if most.count >= len(who):
            report.add((*here, "count"), f"{most.count} of {len(who)} robots limits nothing")
        result.append(AtMost(who, most.count))
    for i, limited in enumerate(given.not_at_once):
        here = (SECTION, "not_at_once", i, "global_tasks")
        calls = [call_text(*split_template(text)) for text in limited.global_tasks]
        tasks = _names(calls, here, report, "the tree has no global task", known_tasks)
        result.append(NotAtOnce(tasks, limited.count))
    if result and model.solver == "min_cost_flow":
        text = "min_cost_flow knows no side constraints; use cp_sat, or leave it out"
        report.add(("solver",), text)
    return tuple(result)


def _global_names(given: ConstraintsModel, built: Built) -> set[str]:
    """Return the known global tasks: the tree's, those named here that jobs may request, all
    types.
    """
    known = set(built.global_tasks)
    for limited in given.not_at_once:
        calls = {call_text(*split_template(text)) for text in limited.global_tasks}
        known |= {
            call for call in calls if any(may_request(job, call) for job in built.jobs.values())
        }
    of_jobs = (type_name(name) for job in built.jobs.values() for name in job.global_tasks)
    return known | {type_name(name) for name in known} | set(of_jobs)


def _names(
    names: Sequence[str],
    place: SourcePath,
    report: Report,
    unknown: str = "",
    known: Iterable[str] | None = None,
) -> tuple[str, ...]:
    """Return the names, sorted. Unknown names and duplicates are reported."""
    for i, name in enumerate(names):
        if known is not None and name not in known:
            report.add((*place, i), f"{unknown} {name!r}{nearest(name, known)}")
        if name in names[:i]:
            report.add((*place, i), f"{name!r} is given twice; keep one")
    return tuple(sorted(set(names)))


def _local_names(
    texts: Sequence[str],
    place: SourcePath,
    local_tasks: Mapping[str, Sequence[str]],
    report: Report,
) -> tuple[str, ...]:
    for i, text in enumerate(texts):
        task, arguments = split_template(text)
        parameters = local_tasks.get(task)
        if parameters is None:
            report.add((*place, i), f"no local task {task!r}{nearest(task, local_tasks)}")
        elif arguments and len(arguments) != len(parameters):
            message = f"{task} has {len(parameters)} parameters, found {len(arguments)}"
            report.add((*place, i), message)
    return _names([call_text(*split_template(text)) for text in texts], place, report)
