"""Local tasks that are trees: `local_tasks: NAME: {tree: ...}` of a mission file.

Such a tree has the shape of the team's. Its actions are local tasks without a tree, its SubTrees
local tasks with one, its conditions the robots' own. What comes out is one ground tree for each
ground local task that some global task needs; nothing behind `Mission.local_trees` knows of files.
"""

from __future__ import annotations

from collections.abc import Iterable

from mrbt_mesh.core.bt.tree import Tree, TreeError, build_tree
from mrbt_mesh.formats.expand import (
    Declared,
    Expander,
    Template,
    TooManyNodesError,
    check_cycles,
    check_template,
    read_template,
    split_template,
)
from mrbt_mesh.formats.mission_model import MissionModel
from mrbt_mesh.formats.problems import Report

WORDS = ("local task", "local condition", "local task with a tree")


class LocalTrees:
    """The trees of a mission's local tasks; what is wrong with them goes to the report."""

    def __init__(self, model: MissionModel, report: Report) -> None:
        self._parameters = model.parameters
        self._report = report
        tasks = {name: list(task.parameters) for name, task in model.local_tasks.items()}
        trees = {
            name: task.tree
            for name, task in model.local_tasks.items()
            if task.tree and task.tree_file is None
        }
        declared = Declared(
            {name: parameters for name, parameters in tasks.items() if name not in trees},
            {name: list(entry.parameters) for name, entry in model.local_conditions.items()},
            {name: tasks[name] for name in trees},
            WORDS,
        )
        self._templates: dict[str, tuple[list[str], Template]] = {}
        for name, tree in trees.items():
            body = read_template(tree, ("local_tasks", name, "tree"), report)
            scope = frozenset(model.parameters) | frozenset(tasks[name])
            check_template(body, declared, scope, report)
            self._templates[name] = (tasks[name], body)
        check_cycles({name: body for name, (_, body) in self._templates.items()}, report)

    def ground(self, local_tasks: Iterable[str]) -> dict[str, Tree]:
        """The tree of each of these ground local tasks that has one, sorted by name."""
        expander = Expander(self._templates, self._parameters, self._report)
        found: dict[str, Tree] = {}
        for ground in sorted(set(local_tasks)):
            name, arguments = split_template(ground)
            if name not in self._templates:
                continue
            parameters, body = self._templates[name]
            scope = {**self._parameters, **dict(zip(parameters, arguments, strict=True))}
            try:
                spec = expander.expand(body, scope)
                if spec is not None:
                    found[ground] = build_tree(spec)
            except TooManyNodesError:
                break
            except TreeError as error:
                self._report.add(("local_tasks", name, "tree"), f"{ground}: {error}")
        return found
