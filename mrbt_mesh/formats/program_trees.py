"""Local tasks that are trees: `local_tasks: NAME: {tree: FILE.xml#TreeID}` of a mission file.

A BehaviorTree.CPP tree becomes part of the mission with every file that it includes, so that all
robots run the same tree. There is one for each ground local task that some global task needs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.mission.program_trees import ProgramTree
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.expand import (
    LocalCalls,
    Scope,
    check_call,
    check_references,
    ground_call,
    substitute,
)
from mrbt_mesh.formats.mission_model import LocalTaskOrTreeModel, MissionModel
from mrbt_mesh.formats.problems import Report
from mrbt_mesh.plugins import tree_format


class ProgramTrees:
    """The trees of a mission's local tasks; problems go to the report."""

    def __init__(self, model: MissionModel, report: Report) -> None:
        self._model = model
        self._report = report
        self._files: dict[str, tuple[str, str, str] | None] | None = None
        conditions = {
            name: entry.parameters
            for entries in (model.conditions, model.blackboard)
            for name, entry in entries.items()
        }
        for name, task in model.local_tasks.items():
            scope = frozenset(model.parameters) | frozenset(task.parameters)
            for port, value in task.ports.items():
                if isinstance(value, str):
                    check_references(value, scope, ("local_tasks", name, "ports", port), report)
            for entry, condition in task.outputs.items():
                place = ("local_tasks", name, "outputs", entry)
                check_call(condition, "condition", conditions, scope, place, report)

    def ground(self, local_tasks: LocalCalls, folder: Path) -> dict[str, ProgramTree]:
        """Return the trees of those ground local tasks that have one in a file below `folder`."""
        if self._files is None:
            self._files = {
                name: self._read(name, task.tree, folder)
                for name, task in sorted(self._model.local_tasks.items())
                if task.tree is not None
            }
        found: dict[str, ProgramTree] = {}
        for ground, arguments in local_tasks.items():
            name = type_name(ground)
            if (tree := self._files.get(name)) is not None:
                task = self._model.local_tasks[name]
                scope = self._scope(task.parameters, arguments)
                found[ground] = ProgramTree(*tree, *self._filled(name, task, scope))
        return found

    def _scope(self, parameters: Iterable[str], arguments: Iterable[str]) -> Scope:
        return {**self._model.parameters, **dict(zip(parameters, arguments, strict=True))}

    def _read(self, name: str, reference: str, folder: Path) -> tuple[str, str, str] | None:
        """Return the file's name, its text and the tree's ID."""
        file, _, tree = reference.partition("#")
        try:
            return file, *tree_format(file).read(folder / file, tree)
        except InputError as error:
            for line in str(error).splitlines():
                self._report.add(("local_tasks", name, "tree"), line)
            return None

    def _filled(
        self, name: str, task: LocalTaskOrTreeModel, scope: Mapping[str, Any]
    ) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]]:
        """Return the ports and outputs with the arguments filled in."""
        ports, outputs = [], []
        try:
            for key, value in sorted(task.ports.items()):
                ports.append((key, _text(value, scope)))
            for key, condition in sorted(task.outputs.items()):
                outputs.append((key, ground_call(condition, scope)[0]))
        except ValueError as error:
            where = "ports" if len(ports) < len(task.ports) else "outputs"
            self._report.add(("local_tasks", name, where, key), str(error))
        return tuple(ports), tuple(outputs)


def _text(value: Any, scope: Mapping[str, Any]) -> str:
    """Return a port's value as it would be written in the file."""
    filled = substitute(value, scope) if isinstance(value, str) else value
    if isinstance(filled, bool):
        return "true" if filled else "false"
    if isinstance(filled, list):
        return ";".join(_text(item, {}) for item in filled)
    return str(filled)
