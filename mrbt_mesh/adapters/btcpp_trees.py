"""Runs BehaviorTree.CPP trees as local tasks: the tree format `xml` of missions and programs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrbt_mesh.btcpp import BehaviorTree, BlackboardError, Leaves, NodeStatus, TickError
from mrbt_mesh.btcpp.files.check import check_file, check_library
from mrbt_mesh.btcpp.files.checkpoints import CHECKPOINT, checkpoints
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.expand import constant_value, expand
from mrbt_mesh.btcpp.files.export import explicit
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library, library_of
from mrbt_mesh.btcpp.scripts.values import ValueTypeError, as_truth
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.names import declared_name
from mrbt_mesh.core.mission.program_trees import ProgramTree
from mrbt_mesh.errors import FileError, Problem, TaskFailedError
from mrbt_mesh.runtime.context import RobotContext, TaskContext


class BtcppTrees:
    """The plug-in: see `plugins.TreeFormat`."""

    def read(self, path: Path, tree: str) -> tuple[str, str]:
        library, findings = check_file(path)
        findings.raise_errors()
        file = str(path)
        chosen = library.chosen_tree(tree)
        if library.missing_files:
            raise FileError(
                Problem(file, 0, "", f"{missing!r}, which it includes, cannot be read")
                for missing in library.missing_files
            )
        checkpoints(expand(library, chosen).root, library)  # raises FileError for wrong ones
        return explicit(library, is_merged=True).text(), chosen

    def leaves(self) -> Leaves:
        return Leaves(TaskContext, RobotContext)

    def problems(
        self, tree: ProgramTree, leaves: Any, conditions: Mapping[str, ConditionType]
    ) -> list[str]:
        try:
            _made_tree(tree, _with_conditions(leaves, conditions))
        except FileError as error:
            return [str(problem) for problem in error.problems]
        except BlackboardError as error:
            return [f"{tree.source}: {tree.tree}: {error}"]
        return []

    async def run(
        self,
        tree: ProgramTree,
        leaves: Any,
        conditions: Mapping[str, ConditionType],
        task: TaskContext,
        report: Callable[[bytes], None],
    ) -> None:
        made = _made_tree(tree, _with_conditions(leaves, conditions), _given(task))
        reached = dict(tree.outputs).get(CHECKPOINT)
        if reached is not None:
            marks = _Checkpoints(made, task, reached, _checkpoints_of(tree))
            marks.go_on()
            made.watch(marks.note)
        try:
            await _carry_out(made, report)
        finally:
            for entry, condition in tree.outputs:
                if entry == CHECKPOINT:
                    continue
                value = made.blackboard.get(entry)
                if not conditions[declared_name(condition)].is_truth:
                    if value is not None:
                        task.set_value(condition, value)
                    continue
                try:
                    task.set_condition(condition, as_truth(value))
                except ValueTypeError:
                    continue  # an entry that is neither true nor false changes nothing

    async def run_file(
        self,
        path: Path,
        tree: str | None,
        leaves: Any,
        task: TaskContext,
        ports: Mapping[str, Any],
    ) -> None:
        made = BehaviorTree.from_file(path, tree, leaves, given=_given(task))
        made.check()
        for name, value in ports.items():
            made.blackboard[name] = value
        await _carry_out(made)


TREES = BtcppTrees()


@dataclass
class _Checkpoints:
    """Tracks the checkpoints of a run, so that another robot can continue it.

    The last checkpoint passed is kept in the entry `reached` of the team's blackboard, together
    with its activation.
    """

    tree: BehaviorTree
    task: TaskContext
    reached: str
    uids: list[int]
    passed: int = 0

    def go_on(self) -> None:
        """Start after the last checkpoint of this activation, if one was passed."""
        run, _, uid = str(self.task.read_value(self.reached)).partition(".")
        if run == self._run and int(uid) in self.uids:
            self.passed = int(uid)
            self.tree.executor.begin_after(self.passed)

    def note(self) -> None:
        """After a tick, report to the team if another checkpoint was passed."""
        statuses = self.tree.executor.statuses()
        done = (NodeStatus.SUCCESS, NodeStatus.SKIPPED)
        last = max((uid for uid in self.uids if statuses[uid - 1] in done), default=0)
        if last > self.passed:
            self.passed = last
            self.task.set_value(self.reached, f"{self._run}.{last}", at_once=True)

    @property
    def _run(self) -> str:
        """The activation as a hash, short enough for a text of the blackboard."""
        return hashlib.sha256(self.task.activation.encode()).hexdigest()[:16]


def _given(task: TaskContext) -> Mapping[type, Any]:
    return {RobotContext: task, TaskContext: task}


def _library_of(program: ProgramTree) -> Library:
    # The text came with the mission: includes are not followed here.
    findings = Findings()
    library = library_of(parse_document(program.xml, program.source), findings)
    check_library(library, findings)
    findings.raise_errors()
    return library


def _checkpoints_of(program: ProgramTree) -> list[int]:
    library = _library_of(program)
    return checkpoints(expand(library, program.tree).root, library)


def _made_tree(
    program: ProgramTree, leaves: Leaves, given: Mapping[type, Any] | None = None
) -> BehaviorTree:
    """Build a tree of a mission and set its entries. Raises FileError and BlackboardError."""
    library = _library_of(program)
    tree = BehaviorTree(library, program.tree, leaves, given=given)
    tree.check()  # so that ports' types are known
    for name, text in program.ports:
        # A typed entry converts a text; otherwise its type is guessed from the text.
        is_typed = bool(tree.blackboard.type_of(name))
        tree.blackboard[name] = text if is_typed else constant_value(text)
    return tree


async def _carry_out(tree: BehaviorTree, report: Callable[[bytes], None] | None = None) -> None:
    """Run a tree to its end. Raises TaskFailedError if it fails, but not if it is skipped.

    `report` is called after each tick with the statuses of the nodes in preorder; a skipped node
    counts as idle.
    """
    reasons: dict[int, str] = {}

    def note() -> None:
        views = list(tree.view())
        reasons.update({view.uid: view.reason for view in views if view.reason})
        if report is not None:
            report(bytes(view.status % NodeStatus.SKIPPED for view in views))

    tree.watch(note)
    try:
        status = await tree.run()
    except TickError as error:
        # The message, then file and line, but not the node's path: reasons must be short.
        place, _, rest = str(error).partition(": ")
        message = rest.partition(": ")[2]
        raise TaskFailedError(f"{message} ({place})" if message else str(error)) from error
    if status is NodeStatus.FAILURE:
        last = list(reasons.values())[-1:]
        raise TaskFailedError(last[0] if last else f"the tree {tree.name} ended as {status.name}")


def _with_conditions(leaves: Leaves, conditions: Mapping[str, ConditionType]) -> Leaves:
    """Return a program's leaves plus the team's conditions for which it has no function.

    The ports of such a leaf are the condition's arguments, by name or, if names differ, in order.
    """
    truths = {name: each for name, each in conditions.items() if each.is_truth}
    return leaves.with_conditions({name: _reader(each) for name, each in truths.items()})


def _reader(condition: ConditionType) -> Callable[..., bool]:
    def read(_task: TaskContext, **ports: Any) -> bool:
        is_named = ports.keys() == set(condition.parameters)
        values = [ports[name] for name in condition.parameters] if is_named else ports.values()
        arguments = ",".join(map(str, values))
        return _task.read_condition(
            f"{condition.name}({arguments})" if arguments else condition.name
        )

    read.__annotations__["_task"] = TaskContext
    return read
