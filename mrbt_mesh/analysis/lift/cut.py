"""Divides a tree at its marks: what the team does itself, and what one robot does each time.

The nodes above marks become nodes of the team's tree. A marked node is a task; so is each child of
a parallel node, and each group of neighbours between tasks. A robot does each task with a separate
blackboard, which is empty at first. Whatever that would break is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from mrbt_mesh.analysis.lift.marks import Marks
from mrbt_mesh.analysis.lift.tasks import Piece, TaskTrees
from mrbt_mesh.analysis.team_tree import translated
from mrbt_mesh.btcpp.files.document import LEAVES, Category
from mrbt_mesh.btcpp.files.entries import access, access_below
from mrbt_mesh.btcpp.files.expand import ExpandedNode, ExpandedTree
from mrbt_mesh.core.bt.tree import NodeSpec
from mrbt_mesh.errors import FileError, Problem

_LOOPS = frozenset({"RetryUntilSuccessful", "Repeat", "KeepRunningUntilFailure"})
# In these, neighbouring children can be one task of one robot.
_IN_ORDER = frozenset({"Sequence", "AsyncSequence", "Fallback", "AsyncFallback"})
# For these, a skipped child is like one that has succeeded.
_GOES_ON = frozenset({"Sequence", "AsyncSequence", "SequenceWithMemory"})
_QUEUES = frozenset({"LoopInt", "LoopBool", "LoopDouble", "LoopString"})
_SKIPPABLE = frozenset({"RunOnce", "SkipUnlessUpdated"})
_DECIDED_BY_ALL = _IN_ORDER | {"SequenceWithMemory", "ReactiveSequence", "ReactiveFallback"}
_REMEMBERS = frozenset(
    {"RunOnce", "SequenceWithMemory", "SkipUnlessUpdated", "WaitValueUpdate", "WasEntryUpdated"}
    | {"PersistentSequence", "SingleTrigger"}
)
_LONGEST_NAME = 64


@dataclass
class TreeCutter:
    """Divides one tree; `tasks` gets the pieces."""

    tree: ExpandedTree
    marks: Marks
    tasks: TaskTrees
    pieces: list[Piece] = field(default_factory=list)

    def team_tree(self) -> NodeSpec:
        """Return the team's tree, whose actions are global tasks. Raises FileError."""
        root = self._node(self.tree.root, False, True)
        problems = [*self._entries(), *self.tasks.problems]
        if problems:
            # One problem per node, however often its tree is used.
            once = {(each.file, each.line, each.path): each for each in reversed(problems)}
            raise FileError(sorted(once.values(), key=lambda each: (each.file, each.line)))
        written = access_below([self.tree.root], self.tasks.library).writes
        fixed = {key: text for key, text in self.tree.constants.items() if key not in written}
        found = translated(self.tasks.library, ExpandedTree(root, fixed), Category.ACTION)
        refusals = [self._refusal(each) for each in (*found.refusals, *found.notes)]
        if refusals or found.spec is None:
            raise FileError(refusals)
        return found.spec

    def _refusal(self, problem: Problem) -> Problem:
        """Return why a node cannot be the team's, and which mark makes it so."""
        for node in self.tree.root.walk():
            mark = self.marks.above.get(id(node))
            if mark is not None and node.path == problem.path and node.line == problem.line:
                why = "" if mark is node else f"; {mark.path}, below it, is marked as the team's"
                return replace(problem, message=f"{problem.message}{why}")
        return problem

    def _node(self, node: ExpandedNode, is_again: bool, may_skip: bool) -> ExpandedNode:
        """Return the team's node for this node.

        `is_again`: a loop above may restart it; `may_skip`: there are only Sequences above it.
        """
        if id(node) not in self.marks.above:
            return self._task(Piece((node,), None, is_again), may_skip)
        is_parallel = id(node) in self.marks.parallel
        if node.type == "WhileDoElse":
            mark = self.marks.above[id(node)]
            why = "it asks its condition again at each tick, and a task of the team is done once; "
            why += (
                f"{mark.path}, below it, is marked as the team's: mark the whole, or nothing of it"
            )
            self.tasks.problems.append(Problem(node.file, node.line, node.path, why))
        is_again = is_again or node.type in _LOOPS
        goes_on = node.category is Category.SUBTREE or node.type in _GOES_ON
        may_skip = may_skip and goes_on
        children = [
            self._node(group[0], is_again, may_skip)
            if len(group) == 1
            else self._task(Piece(tuple(group), node, is_again), may_skip)
            for group in self._groups(node, is_parallel)
        ]
        # Names in a mission have no slash, because paths are made of them.
        name = node.name.replace("/", "-").replace("\n", " ")[:_LONGEST_NAME]
        if not is_parallel:
            return replace(node, children=children, name=name)
        all_needed = node.type == "Sequence"
        needed, allowed = ("-1", "1") if all_needed else ("1", "-1")
        return replace(
            node,
            type="Parallel",
            name=name if name != node.type else "Parallel",
            ports={"success_count": needed, "failure_count": allowed},
            children=children,
        )

    def _groups(self, node: ExpandedNode, is_parallel: bool) -> Iterator[list[ExpandedNode]]:
        """Yield the children, grouped by what one robot does together."""
        group: list[ExpandedNode] = []
        for child in node.children:
            is_apart = id(child) in self.marks.team or id(child) in self.marks.above
            if is_apart or is_parallel or node.type not in _IN_ORDER:
                yield from filter(None, [group])
                group = []
                yield [child]
            else:
                group.append(child)
        yield from filter(None, [group])

    def _task(self, piece: Piece, may_skip: bool) -> ExpandedNode:
        first = piece.nodes[0]
        self.pieces.append(piece)
        if not may_skip and all(map(_is_skippable, piece.nodes)):
            why = "it may be skipped, which a task of the team cannot be here"
            self.tasks.problems.append(Problem(first.file, first.line, first.path, why))
        for node in _all(piece):
            if piece.is_again and node.type in _REMEMBERS:
                why = f"{node.type} remembers earlier rounds of the loop above, which other robots "
                why += "may have done; mark the loop, not a part of it"
                self.tasks.problems.append(Problem(node.file, node.line, node.path, why))
        call = self.tasks.use(piece)
        return replace(
            first,
            type=call,
            category=Category.ACTION,
            name=call,
            ports={},
            conditions={},
            metadata={},
            children=[],
            call=call,
        )

    def _entries(self) -> Iterator[Problem]:
        """Yield problems of entries that would have to pass from one robot to another."""
        library = self.tasks.library
        writes = [access_below(piece.nodes, library) for piece in self.pieces]
        for number, piece in enumerate(self.pieces):
            first = piece.nodes[0]
            if writes[number].writes_any and len(self.pieces) > 1:
                why = "it writes an entry that is only known when it runs; others may need it"
                yield Problem(first.file, first.line, first.path, why)
            for entry in sorted(self.tasks.flow(piece).kept):
                others = [
                    other
                    for place, other in enumerate(self.pieces)
                    if entry in writes[place].writes and (place != number or piece.is_again)
                ]
                if others:
                    yield self._crossing(piece, entry, others[0])

    def _crossing(self, piece: Piece, entry: str, writer: Piece) -> Problem:
        library = self.tasks.library
        reader = next(n for n in _all(piece) if entry in access(n, library).reads)
        by = next(n for n in _all(writer) if entry in access(n, library).writes)
        key = next(iter(reader.scope.names_of(entry)), entry)
        if writer is piece:
            why = "the loop above begins this task with an empty blackboard, maybe on another "
            why += "robot; mark the loop, not a part of it"
        else:
            why = f"{by.path} (line {by.line}) writes it, which another robot may do; leave both "
            why += "in one task"
        if library.model(by.type) is None and by.category in LEAVES:
            why += f", or describe {by.type} in <TreeNodesModel> if it does not write or read it"
        return Problem(reader.file, reader.line, reader.path, f"it reads {{{key}}}: {why}")


def _all(piece: Piece) -> Iterator[ExpandedNode]:
    return (node for top in piece.nodes for node in top.walk())


def _is_skippable(node: ExpandedNode) -> bool:
    """Return whether a node may end as SKIPPED, after which a Fallback continues."""
    if {"_skipIf", "_while"} & node.conditions.keys() or node.type in _SKIPPABLE:
        return True
    if node.type == "Precondition":
        return node.ports.get("else", "FAILURE") == "SKIPPED"
    if node.type in _QUEUES and node.ports.get("if_empty", "SUCCESS") not in ("SUCCESS", "FAILURE"):
        return True
    found = [_is_skippable(child) for child in node.children]
    return all(found) and bool(found) if node.type in _DECIDED_BY_ALL else any(found)
