"""Checkpoints: nodes of a robot's tree after which another robot can continue.

A node with `_checkpoint="true"` is one; BehaviorTree.CPP keeps this attribute and ignores it. A
blackboard is lost with its robot, so no node after a checkpoint may read an entry written before.
"""

from __future__ import annotations

from collections.abc import Iterator

from mrbt_mesh.btcpp.files.document import Category
from mrbt_mesh.btcpp.files.entries import access_below
from mrbt_mesh.btcpp.files.entry_flow import flow_in_turn
from mrbt_mesh.btcpp.files.expand import ExpandedNode
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.errors import FileError, Problem

CHECKPOINT = "_checkpoint"
# Controls in the middle of which a run can start.
_STEPS = ("Sequence", "AsyncSequence")


def is_marked(node: ExpandedNode, mark: str) -> bool:
    """Return whether a node's attribute `mark` is true. Raises FileError if it is no boolean."""
    text = node.metadata.get(mark, "false")
    value = read_boolean(text)
    if value is None:
        raise problem_at(node, f"{mark}={text!r} is neither true nor false")
    return value


def problem_at(node: ExpandedNode, message: str) -> FileError:
    """Return a FileError with this message at the place of a node."""
    return FileError([Problem(node.file, node.line, node.path, message)])


def checkpoints(root: ExpandedNode, library: Library) -> list[int]:
    """Return the numbers of the checkpoints of a tree; nodes are numbered in preorder from 1.

    Raises FileError for a checkpoint after which no robot could continue.
    """
    found: list[int] = []
    problems: list[Problem] = []
    # Each node with its path from the root: pairs of an ancestor and the index of its next child.
    waiting: list[tuple[ExpandedNode, tuple[tuple[ExpandedNode, int], ...]]] = [(root, ())]
    number = 0
    while waiting:
        node, above = waiting.pop()
        number += 1
        if is_marked(node, CHECKPOINT):
            found.append(number)
            problems += _problems(node, above, library)
        below = [(child, (*above, (node, place))) for place, child in enumerate(node.children)]
        waiting += reversed(below)
    if problems:
        raise FileError(problems)
    return found


def _problems(
    node: ExpandedNode, above: tuple[tuple[ExpandedNode, int], ...], library: Library
) -> Iterator[Problem]:
    done = [node]
    rest: list[ExpandedNode] = []
    for step, position in above:
        if step.type not in _STEPS and step.category is not Category.SUBTREE:
            why = f"is below {step.path}; only Sequences and SubTrees may be above a checkpoint"
            yield Problem(node.file, node.line, node.path, f"{CHECKPOINT}: {why}")
            return
        if step.conditions:
            why = f"is below {step.path}, which has {next(iter(step.conditions))}"
            yield Problem(node.file, node.line, node.path, f"{CHECKPOINT}: {why}")
            return
        done += step.children[:position]
        rest = step.children[position + 1 :] + rest
    lost = flow_in_turn(rest, library).kept & access_below(done, library).writes
    for entry in sorted(lost):
        reader = next(r for r in rest if entry in access_below([r], library).reads)
        why = f"{reader.path} reads {{{entry}}}, which was written before it: another robot, "
        why += "which goes on here, does not have it"
        yield Problem(node.file, node.line, node.path, f"{CHECKPOINT}: {why}")
