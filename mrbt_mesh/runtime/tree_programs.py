"""Local tasks that are BehaviorTree.CPP trees, run by a robot's program."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mrbt_mesh.btcpp import BehaviorTree, BlackboardError, Leaves, NodeStatus, TickError
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.expand import constant_value
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from mrbt_mesh.btcpp.scripts.values import ValueTypeError, as_truth
from mrbt_mesh.core.mission.program_trees import ProgramTree
from mrbt_mesh.errors import FileError, TaskFailedError


def made_tree(
    program: ProgramTree, leaves: Leaves, given: Mapping[type, Any] | None = None
) -> BehaviorTree:
    """The tree of a mission, with its entries set. Raises FileError and BlackboardError."""
    library = library_of(parse_document(program.xml, program.source), Findings())
    tree = BehaviorTree(library, program.tree, leaves, given=given)
    tree.check()  # so that ports' types are known
    for name, text in program.ports:
        # A text becomes what an entry that has a type needs; else it is what it looks like.
        is_typed = bool(tree.blackboard.type_of(name))
        tree.blackboard[name] = text if is_typed else constant_value(text)
    return tree


def lacking_leaves(program: ProgramTree, leaves: Leaves) -> list[str]:
    """What keeps a program from running this tree, each with file, line and node."""
    try:
        made_tree(program, leaves)
    except FileError as error:
        return [str(problem) for problem in error.problems]
    except BlackboardError as error:
        return [f"{program.source}: {program.tree}: {error}"]
    return []


async def carry_out(
    tree: BehaviorTree,
    ports: Mapping[str, Any],
    tell: Callable[[bytes], None] | None = None,
) -> None:
    """Run a tree to its end. Raises TaskFailedError unless it succeeds.

    `tell` hears the statuses of its nodes in preorder after each tick; a skipped node is idle.
    """
    tree.check()
    for name, value in ports.items():
        tree.blackboard[name] = value
    reasons: dict[int, str] = {}

    def note() -> None:
        views = list(tree.view())
        reasons.update({view.uid: view.reason for view in views if view.reason})
        if tell is not None:
            tell(bytes(view.status % NodeStatus.SKIPPED for view in views))

    tree.watch(note)
    try:
        status = await tree.run()
    except TickError as error:
        raise TaskFailedError(_what_first(error)) from error
    if status is not NodeStatus.SUCCESS:
        last = list(reasons.values())[-1:]
        raise TaskFailedError(last[0] if last else f"the tree {tree.name} ended as {status.name}")


def _what_first(error: TickError) -> str:
    """What is wrong, then its file and line: reasons are short, and paths of nodes are long."""
    place, _, rest = str(error).partition(": ")
    _, _, message = rest.partition(": ")
    return f"{message} ({place})" if message else str(error)


def told_outputs(program: ProgramTree, tree: BehaviorTree) -> dict[str, bool]:
    """The conditions that the tree's entries tell; entries without a truth tell nothing."""
    told = {}
    for entry, condition in program.outputs:
        try:
            told[condition] = as_truth(tree.blackboard.get(entry))
        except ValueTypeError:
            continue
    return told
