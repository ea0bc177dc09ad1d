"""Local tasks that are BehaviorTree.CPP trees: `local_tasks: NAME: {tree: FILE.xml#TreeID}`.

The file and all that it includes becomes part of the mission, so that every robot runs the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.core.mission.program_trees import ProgramTree
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.formats.expand import argument_text, call_text, split_template, substitute
from mrbt_mesh.formats.mission_model import LocalTaskOrTreeModel, MissionModel
from mrbt_mesh.formats.problems import Report
from mrbt_mesh.plugins import tree_format


def ground_program_trees(
    model: MissionModel, local_tasks: Iterable[str], folder: Path, report: Report
) -> dict[str, ProgramTree]:
    """The trees of these ground local tasks that are in files, by name; problems go to `report`."""
    trees = {
        name: _read(name, task, folder, report)
        for name, task in sorted(model.local_tasks.items())
        if task.tree_file is not None
    }
    found: dict[str, ProgramTree] = {}
    for ground in local_tasks:
        name, arguments = split_template(ground)
        read = trees.get(name)
        if read is not None:
            task = model.local_tasks[name]
            bound = dict(zip(task.parameters, arguments, strict=True))
            filled = _filled(name, task, {**model.parameters, **bound}, model, report)
            found[ground] = ProgramTree(*read, *filled)
    return found


def _read(
    name: str, task: LocalTaskOrTreeModel, folder: Path, report: Report
) -> tuple[str, str, str] | None:
    """The file's name, its text and the tree's ID."""
    place = ("local_tasks", name, "tree")
    file, _, tree = (task.tree_file or "").partition("#")
    try:
        text, chosen = tree_format(file).read(folder / file, tree)
    except InputError as error:
        for line in str(error).splitlines():
            report.add(place, line)
        return None
    return file, text, chosen


def _filled(
    name: str,
    task: LocalTaskOrTreeModel,
    scope: Mapping[str, Any],
    model: MissionModel,
    report: Report,
) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...]]:
    """Ports and outputs with the arguments in place."""
    ports, outputs = [], []
    for port, value in sorted(task.ports.items()):
        try:
            ports.append((port, _text(value, scope)))
        except (KeyError, ValueError) as error:
            report.add(("local_tasks", name, "ports", port), f"{value!r}: {error} is not known")
    for entry, condition in sorted(task.outputs.items()):
        place = ("local_tasks", name, "outputs", entry)
        called, templates = split_template(condition)
        declared = model.conditions.get(called)
        if declared is None:
            report.add(
                place, f"condition {called!r} is not declared{nearest(called, model.conditions)}"
            )
        elif len(declared.parameters) != len(templates):
            wanted = len(declared.parameters)
            report.add(
                place, f"condition {called!r} takes {wanted} arguments, not {len(templates)}"
            )
        else:
            try:
                filled = [argument_text(substitute(each, scope)) for each in templates]
            except (KeyError, ValueError) as error:
                report.add(place, f"{condition!r}: {error} is not known")
                continue
            outputs.append((entry, call_text(called, filled)))
    return tuple(ports), tuple(outputs)


def _text(value: Any, scope: Mapping[str, Any]) -> str:
    """A port's value as a text of the file would give it."""
    filled = substitute(value, scope) if isinstance(value, str) else value
    if isinstance(filled, bool):
        return "true" if filled else "false"
    if isinstance(filled, list):
        return ";".join(_text(item, {}) for item in filled)
    return str(filled)
