"""Local tasks that are BehaviorTree.CPP trees: `local_tasks: NAME: {tree: FILE.xml#TreeID}`.

The file and all that it includes becomes part of the mission, so that every robot runs the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.export import explicit
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.core.mission.program_trees import ProgramTree
from mrbt_mesh.errors import FileError, nearest
from mrbt_mesh.formats.expand import argument_text, call_text, split_template, substitute
from mrbt_mesh.formats.mission_model import LocalTaskOrTreeModel, MissionModel
from mrbt_mesh.formats.problems import Report


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
        library, findings = check_file(folder / file)
        findings.raise_errors()
    except FileError as error:
        for problem in error.problems:
            report.add(place, str(problem))
        return None
    chosen = _chosen(tree, library)
    if chosen is None:
        known = nearest(tree, list(library.trees))
        report.add(place, f"{file}: there is no tree {tree!r}{known}" if tree else f"{file}{known}")
        return None
    for missing in library.missing_files:
        report.add(place, f"{file}: {missing!r}, which it includes, cannot be read")
    return file, explicit(library, is_merged=True).text(), chosen


def _chosen(tree: str, library: Library) -> str | None:
    if not tree:
        return library.main_tree
    return tree if tree in library.trees else None


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
