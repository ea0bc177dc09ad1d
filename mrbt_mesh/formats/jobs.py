"""Read `jobs` of a mission file: job types and the values that their parameters may have."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from mrbt_mesh.core.bt.tree import MAX_NODES, Kind, Tree
from mrbt_mesh.core.mission.jobs import arguments_in, most_nodes
from mrbt_mesh.core.mission.mission import JobParameter, JobType
from mrbt_mesh.core.mission.names import placeholder
from mrbt_mesh.formats.expand import (
    Declared,
    JobTree,
    Placeholder,
    Template,
    check_template,
    micro_or_report,
    read_template,
)
from mrbt_mesh.formats.listed_values import listed_values
from mrbt_mesh.formats.mission_map import places_on_map
from mrbt_mesh.formats.mission_model import JobTypeModel, MissionModel, RangeModel
from mrbt_mesh.formats.problems import Report, SourcePath
from mrbt_mesh.formats.tree_model import ALL_TYPES


class JobTypes:
    """The job types of a mission; problems go to the report.

    `places` are those of `travel`; if empty, those of the map are used.
    """

    def __init__(self, model: MissionModel, places: Collection[str], report: Report) -> None:
        self._model = model
        self._report = report
        self._places = places or sorted(places_on_map(model.parameters))
        self._types = {name: self._read(name, entry) for name, entry in sorted(model.jobs.items())}

    def templates(self, declared: Declared) -> dict[str, JobTree]:
        """Return the tree of each type, checked."""
        trees = {}
        for name, known in self._types.items():
            entry, path = self._model.jobs[name], ("jobs", name, "tree")
            template = read_template(entry.tree, path, self._report)
            scope = frozenset({*self._model.parameters, *self._model.blackboard, *entry.parameters})
            check_template(template, declared, scope, self._report)
            if entry.attempts != 1:
                template = Template(path, Kind.RETRY, children=(template,), limit=entry.attempts)
            trees[name] = JobTree(template, {p.name: _placeholder(p) for p in known.parameters})
        return trees

    def check_nodes(self, tree: Tree, types: Mapping[str, JobTree]) -> None:
        """Check that each type is in a Jobs node, that all jobs have room, and how the mission
        ends.
        """
        for name, known in types.items():
            if not known.is_placed:
                message = f"no Jobs node has it; write {{Jobs: [{name}]}} where its jobs belong"
                self._report.add(("jobs", name), message)
        ends = any(known.ends_mission for known in self._types.values())
        if (most := most_nodes(tree)) > MAX_NODES:
            message = f"with all its jobs the tree has {most} nodes, and {MAX_NODES} are allowed"
            self._report.add(("tree",), f"{message}; give its Jobs nodes a smaller at_most")
        if types and not ends and self._model.ends == "once":
            message = "a team that waits for jobs does not end by itself; write ends: never"
            self._report.add(("jobs",), f"{message}, or ends_mission: true for a type of jobs")

    def __getitem__(self, name: str) -> JobType:
        """Return a type, without its tasks."""
        return self._types[name]

    def _read(self, name: str, entry: JobTypeModel) -> JobType:
        path = ("jobs", name)
        if name == ALL_TYPES:
            message = f"{ALL_TYPES} means all types in a Jobs node; choose another name"
            self._report.add(path, message)
        parameters = tuple(
            self._parameter(parameter, values, (*path, "parameters", parameter))
            for parameter, values in entry.parameters.items()
        )
        deadline_us = None
        if entry.deadline_s is not None:
            deadline_us = micro_or_report(entry.deadline_s, (*path, "deadline_s"), self._report)
        return JobType(name, parameters, entry.priority, deadline_us, entry.ends_mission)

    def _parameter(self, name: str, given: Any, path: SourcePath) -> JobParameter:
        if isinstance(given, RangeModel):
            if given.min > given.max:
                self._report.add(path, f"min is {given.min}, but max is {given.max}")
            return JobParameter(name, (), given.min, given.max)
        if given == "place":
            if not self._places:
                message = "there are no places; declare travel, or parameters: map with places"
                self._report.add(path, message)
            return JobParameter(name, tuple(self._places) or ("none",))
        return JobParameter(
            name, listed_values(given, self._model, path, self._report) or ("none",)
        )


def may_request(known: JobType, ground: str) -> bool:
    """True if a job of this type can request the global task with this ground name."""
    bindings = (arguments_in(pattern, ground) for pattern in known.global_tasks)
    parameters = {parameter.name: parameter for parameter in known.parameters}
    return any(
        not any(parameters[name].problem(value) for name, value in values.items())
        for values in bindings
        if values is not None
    )


def _placeholder(parameter: JobParameter) -> Placeholder:
    ends = parameter.choices or (str(parameter.low), str(parameter.high))
    return Placeholder(placeholder(parameter.name), len(parameter.longest()), ends)
