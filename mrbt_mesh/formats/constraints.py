"""`constraints` of a mission file: what they name is looked up."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from mrbt_mesh.core.mission.constraints import AtMost, Constraint, NeverTogether, NotAtOnce
from mrbt_mesh.core.mission.names import split_call, type_name
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.expand import call_text, split_template
from mrbt_mesh.formats.mission_model import ConstraintsModel
from mrbt_mesh.formats.problems import Report, SourcePath


def build_constraints(
    model: ConstraintsModel,
    robots: Iterable[str],
    local_tasks: Mapping[str, Sequence[str]],
    global_tasks: Iterable[str],
    report: Report,
) -> tuple[Constraint, ...]:
    """The constraints, with what they name looked up; problems go to the report.

    `local_tasks` maps types to parameters, `global_tasks` are the ground ones of the tree.
    """
    builder = _Builder(frozenset(robots), local_tasks, frozenset(global_tasks), report)
    result: list[Constraint] = []
    path: SourcePath = ("constraints",)
    for i, together in enumerate(model.never_together):
        here = (*path, "never_together", i)
        names = builder.local_names(together.local_tasks, (*here, "local_tasks"))
        result.append(NeverTogether(builder.robot_names(together.robots, here), names))
    for i, most in enumerate(model.at_most):
        here = (*path, "at_most", i)
        who = builder.robot_names(most.robots, here)
        if most.count >= len(who):
            report.add((*here, "count"), f"{most.count} of {len(who)} robots limits nothing")
        result.append(AtMost(who, most.count))
    for i, once in enumerate(model.not_at_once):
        here = (*path, "not_at_once", i)
        tasks = builder.global_names(once.global_tasks, (*here, "global_tasks"))
        result.append(NotAtOnce(tasks, once.count))
    return tuple(result)


class _Builder:
    def __init__(
        self,
        robots: frozenset[str],
        local_tasks: Mapping[str, Sequence[str]],
        global_tasks: frozenset[str],
        report: Report,
    ) -> None:
        self._robots = robots
        self._local_tasks = local_tasks
        self._global_tasks = global_tasks
        self._report = report

    def robot_names(self, names: Sequence[str], path: SourcePath) -> tuple[str, ...]:
        for i, name in enumerate(names):
            if name not in self._robots:
                text = f"no robot {name!r}{nearest(name, self._robots)}"
                self._report.add((*path, "robots", i), text)
        return self._once(names, (*path, "robots"))

    def local_names(self, texts: Sequence[str], path: SourcePath) -> tuple[str, ...]:
        names = [call_text(*split_template(text)) for text in texts]
        for i, name in enumerate(names):
            task, arguments = split_call(name)
            parameters = self._local_tasks.get(task)
            if parameters is None:
                text = f"no local task {task!r}{nearest(task, self._local_tasks)}"
                self._report.add((*path, i), text)
            elif arguments and len(arguments) != len(parameters):
                text = f"{task} has {len(parameters)} parameters, found {len(arguments)}"
                self._report.add((*path, i), text)
        return self._once(names, path)

    def global_names(self, texts: Sequence[str], path: SourcePath) -> tuple[str, ...]:
        names = [call_text(*split_template(text)) for text in texts]
        types = {type_name(ground) for ground in self._global_tasks}
        known = types | self._global_tasks
        for i, name in enumerate(names):
            if name not in known:
                text = f"the tree has no global task {name!r}{nearest(name, known)}"
                self._report.add((*path, i), text)
        return self._once(names, path)

    def _once(self, names: Sequence[str], path: SourcePath) -> tuple[str, ...]:
        for i, name in enumerate(names):
            if name in names[:i]:
                self._report.add((*path, i), f"{name!r} is given twice; keep one")
        return tuple(sorted(set(names)))
