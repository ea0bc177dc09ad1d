"""The folder that `mrbt tree lift` writes: a mission, the trees of its local tasks, a program."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mrbt_mesh.analysis.lift.cut import TreeCutter
from mrbt_mesh.analysis.lift.marks import WantedMarks, find_marks
from mrbt_mesh.analysis.lift.program import program_text
from mrbt_mesh.analysis.lift.tasks import LiftedTask, TaskTrees, TaskUse
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.checkpoints import CHECKPOINT
from mrbt_mesh.btcpp.files.document import SUBTREE, Category, read_document
from mrbt_mesh.btcpp.files.expand import ExpandedTree, expand
from mrbt_mesh.btcpp.files.folder import read_folder
from mrbt_mesh.btcpp.files.library import Library, together
from mrbt_mesh.core.bt.tree import NodeSpec
from mrbt_mesh.errors import FileError, InputError, Problem
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_writer import mission_text, tree_data
from mrbt_mesh.formats.shipped import MISSION, mission_name

TREES, PROGRAM = "trees.xml", "robot.py"
# Length of an activation and a node's number: mrbt_mesh/adapters/btcpp_trees.py.
_LONGEST_CHECKPOINT = 24
_TEST = '''\
"""The mission in virtual time, also with a fault. Run it with `pytest`.

A warning names each condition of robot.py that is not filled in yet, and answers True.
"""

from mrbt_mesh.testing import Kill, RunMission


def test_the_mission_succeeds(run_mission: RunMission) -> None:
    assert run_mission("mission.yaml").result == "success"


def test_another_robot_replaces_one_that_dies(run_mission: RunMission) -> None:
    assert run_mission("mission.yaml", faults=[(1, Kill("R1"))]).result == "success"
'''


@dataclass(frozen=True)
class TreeFiles:
    """Where a tree is.

    Its file, its ID (None: the main tree), files and folders with SubTrees and models, and SubTrees
    in no file that are actions of the program.
    """

    file: Path
    tree: str | None = None
    models: Sequence[Path] = ()
    folders: Sequence[Path] = ()
    actions: Sequence[str] = ()


@dataclass(frozen=True)
class Lifted:
    """The team's tree, its local tasks and where they are called, and the files by name."""

    tree: NodeSpec
    tasks: Mapping[str, LiftedTask]
    uses: Sequence[TaskUse]
    files: Mapping[str, str] = field(default_factory=dict)


def lift_files(
    files: TreeFiles,
    marks: WantedMarks,
    robots: int,
    folder: Path | None = None,
    program: Path | None = None,
) -> Lifted:
    """Lift a tree for a team with this number of robots. Raises InputError and FileError.

    `folder` is where the files will be; None: only analyse. `program`: the robots' program; without
    it, one is written, to be filled in.
    """
    library, tree = library_and_tree(files)
    library.take_in(tree)
    expanded = expand(library, tree)
    _check_subtrees(expanded)
    tasks = TaskTrees(library, tree, expanded)
    spec = TreeCutter(expanded, find_marks(expanded.root, marks), tasks).team_tree()
    lifted = Lifted(spec, tasks.tasks, tasks.uses)
    name = mission_name((folder or files.file).resolve().stem)
    reference = PROGRAM
    if program is not None:
        path, suffix, function = str(program).rpartition(".py")
        start = (folder or Path()).resolve()
        reference = f"{os.path.relpath(Path(f'{path}.py').resolve(), start)}{function}"
        if not suffix:
            raise InputError(f"--program {program}: a Python file is expected")
        if not Path(f"{path}.py").is_file():
            raise InputError(f"--program {program}: there is no such file")
    heading = f"The tree {tree} of {files.file.name}, lifted by `mrbt tree lift`."
    found = {
        MISSION: mission_text(_mission_data(lifted, name, reference, robots), heading),
        TREES: tasks.document(TREES).text(),
    }
    _check(found, files.file)
    if program is None:
        found[PROGRAM] = program_text(library, tree, files.file.name)
        found["test_mission.py"] = _TEST
    return replace(lifted, files=found)


def library_and_tree(files: TreeFiles) -> tuple[Library, str]:
    """Return the checked file and the ID of the tree to lift. Raises InputError.

    It is the main tree or, where BehaviorTree.CPP requires a name, the only tree that no other tree
    of the file uses.
    """
    library, findings = check_file(files.file, others=_known_besides(files))
    findings.raise_errors()
    try:
        library.make_actions(files.actions)
    except ValueError as error:
        raise InputError(f"--as-action: {error}") from None
    own, tree = library.own_trees, files.tree
    elements = [element for source in own.values() for element in source.element.walk()]
    used = {element.get("ID") for element in elements if element.tag == SUBTREE}
    outermost = [name for name in own if name not in used]
    name = tree or library.main_tree or (outermost[0] if len(outermost) == 1 else None)
    if name is None or name not in library.trees:
        known = ", ".join(own) or "none"
        what = f"there is no tree {tree!r}" if tree else "no tree is named as the main one"
        raise InputError(f"{files.file}: {what}; choose with --tree (there are: {known})")
    return library, name


def _known_besides(files: TreeFiles) -> Library:
    """Return the trees and models of other files, and of all files of folders.

    Raises InputError.
    """
    documents = [read_document(path) for path in files.models]
    for folder in files.folders:
        if not folder.is_dir():
            raise InputError(f"--trees {folder}: there is no such folder")
        documents += read_folder(folder).documents.values()
    return together(documents)


def _check_subtrees(tree: ExpandedTree) -> None:
    """Raise FileError for a SubTree that is in none of the files: nobody could carry it out."""
    problems = [
        Problem(
            node.file,
            node.line,
            node.path,
            f"there is no tree {node.type!r}; name its file (--models) or its folder (--trees), or "
            f"make it an action of the program (--as-action {node.type!r})",
        )
        for node in tree.root.walk()
        if node.category is Category.SUBTREE and not node.children
    ]
    if problems:
        raise FileError(problems)


def _mission_data(lifted: Lifted, name: str, program: str, robots: int) -> dict[str, Any]:
    """Return the mission file: every task is for one robot, and fails when that robot fails."""
    tasks = lifted.tasks.values()
    data: dict[str, Any] = {"mission": name, "program": program}
    data["local_tasks"] = {task.name: _local_task(task) for task in tasks}
    reached = {
        _checkpoint(task): {
            **({"parameters": list(task.parameters)} if task.parameters else {}),
            "text": _LONGEST_CHECKPOINT,
        }
        for task in tasks
        if task.has_checkpoints
    }
    if reached:
        data["blackboard"] = reached
    data["robot_types"] = {"robot": {"capabilities": {task.name: 1 for task in tasks}}}
    data["robots"] = {f"R{number + 1}": "robot" for number in range(robots)}
    data["global_tasks"] = {
        task.name: {
            **({"parameters": list(task.parameters)} if task.parameters else {}),
            "needs": {_call(task.name, task): {"min": 1, "max": 1}},
            "failure": "first",
        }
        for task in tasks
    }
    data["tree"] = tree_data(lifted.tree)
    return data


def _local_task(task: LiftedTask) -> dict[str, Any]:
    data: dict[str, Any] = {"parameters": list(task.parameters)} if task.parameters else {}
    data["tree"] = f"{TREES}#{task.tree}"
    if task.ports:
        data["ports"] = dict(task.ports)
    if task.has_checkpoints:
        data["outputs"] = {CHECKPOINT: _call(_checkpoint(task), task)}
    return data


def _checkpoint(task: LiftedTask) -> str:
    """Return the blackboard entry with a task's last checkpoint."""
    return f"{task.name}{CHECKPOINT}"


def _call(name: str, task: LiftedTask) -> str:
    arguments = ", ".join(f"${parameter}" for parameter in task.parameters)
    return f"{name}({arguments})" if arguments else name


def _check(files: Mapping[str, str], source: Path) -> None:
    """Raise FileError unless the mission can be loaded."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / TREES).write_text(files[TREES], encoding="utf-8")
        try:
            mission_from_yaml(files[MISSION], MISSION, Path(folder))
        except FileError as error:
            first = Problem(str(source), 0, "", "the mission would have these problems")
            here = [
                replace(p, message=re.sub(r"\S*/(?=trees\.xml)", "", p.message))
                for p in error.problems
            ]
            raise FileError([first, *here]) from None


def explained(lifted: Lifted) -> Iterator[str]:
    """Yield a description of the tasks, with the nodes of each."""
    if len(lifted.uses) == 1:
        (use,) = lifted.uses
        after = "its last checkpoint" if use.task.has_checkpoints else "the beginning"
        yield f"One task, {use.call}: one robot does all of it, another goes on from {after}."
        return
    yield f"{len(lifted.uses)} tasks, each for one robot, with a blackboard of its own:"
    for use in lifted.uses:
        first = use.piece.nodes[0]
        names = ", ".join(node.name for node in use.piece.nodes)
        yield f"  {use.call}: {names} ({first.path}:{first.line})"
