"""Behavior trees as immutable data: kinds of nodes, the tree, and how to build one.

A tree holds no run state. Nodes are numbered in depth-first preorder, so an index names the same
node on every robot that runs the same mission. The kinds are those of the paper, section III, and
others of BehaviorTree.CPP 4; `evaluator` has their rules.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from mrbt_mesh.core.codec import NOT_WRITTEN

MAX_DEPTH = 64
MAX_NODES = 20_000


class Kind(enum.StrEnum):
    """The kinds of nodes. A SubTree is transparent: it names its one child. The children of Jobs
    are the open jobs, in a mission that waits for jobs their types (`mission.jobs`).
    """

    SEQUENCE = "Sequence"
    FALLBACK = "Fallback"
    PARALLEL = "Parallel"
    ACTION = "Action"
    CONDITION = "Condition"
    INVERTER = "Inverter"
    FORCE_SUCCESS = "ForceSuccess"
    FORCE_FAILURE = "ForceFailure"
    RETRY = "RetryUntilSuccessful"
    REPEAT = "Repeat"
    TIMEOUT = "Timeout"
    KEEP_RUNNING_UNTIL_FAILURE = "KeepRunningUntilFailure"
    IF_THEN_ELSE = "IfThenElse"
    SUBTREE = "SubTree"
    JOBS = "Jobs"


class Memory(enum.StrEnum):
    """How long a control remembers which of its children have ended.

    `NONE`: it ticks all of them again (the paper's nodes; BehaviorTree.CPP's ReactiveSequence,
    ReactiveFallback, WhileDoElse). `WHILE_RUNNING`: until it has ended itself (BehaviorTree.CPP's
    Sequence, Fallback, Parallel, IfThenElse). `UNTIL_SUCCESS`: a failure does not make it forget
    either (its SequenceWithMemory).
    """

    NONE = "none"
    WHILE_RUNNING = "while_running"
    UNTIL_SUCCESS = "until_success"


CONTROLS = frozenset({Kind.SEQUENCE, Kind.FALLBACK, Kind.PARALLEL, Kind.IF_THEN_ELSE})
LEAVES = frozenset({Kind.ACTION, Kind.CONDITION})
ATTEMPT_KINDS = frozenset({Kind.RETRY, Kind.REPEAT, Kind.KEEP_RUNNING_UNTIL_FAILURE})


class Status(enum.IntEnum):
    """What a node returns; `IDLE` means that it was not ticked."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3


class TreeError(ValueError):
    """A tree that breaks a structural rule; the message names the node's path."""


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """A node with its children nested, as formats produce it; `build_tree` numbers it.

    `subject` is the global task, local task or condition of a leaf, else empty.
    `limit` is M of a Parallel, or the attempts or cycles of a Retry or Repeat (-1: no limit).
    `timeout_us` is the time limit of a Timeout, in microseconds. `memory` is that of a control.
    `failures`: the number of failed children that fails a Parallel; 0: only as many as put M out of
    reach (the paper's rule). `origin`: the index in the tree of the mission file, of a node that
    belongs to a job; -1: its own index. `job`: the id of that job. `number`: by which facts name
    the node; -1: its `origin`, as in a mission that was never revised.
    """

    kind: Kind
    children: tuple[NodeSpec, ...] = ()
    name: str = ""
    subject: str = ""
    limit: int = 0
    timeout_us: int = 0
    memory: Memory = Memory.NONE
    failures: int = 0
    origin: int = field(default=-1, metadata=NOT_WRITTEN)
    job: str = field(default="", metadata=NOT_WRITTEN)
    number: int = field(default=-1, metadata=NOT_WRITTEN)

    def contains(self, kind: Kind) -> bool:
        """Whether this node or any below it is of the kind."""
        return self.kind is kind or any(child.contains(kind) for child in self.children)


@dataclass(frozen=True, slots=True)
class Node:
    """One numbered node; `children` and `parent` are indices, parent -1 at the root.

    (`origin`, `job`) names the same node in every tree of a mission, whichever jobs are open, and
    (`number`, `job`) also in its revisions.
    """

    index: int
    kind: Kind
    parent: int
    children: tuple[int, ...]
    name: str
    subject: str
    limit: int
    timeout_us: int
    memory: Memory = Memory.NONE
    failures: int = 0
    origin: int = -1
    job: str = ""
    number: int = -1

    @property
    def key(self) -> str:
        """(`number`, `job`) as text: `7`, `7@morning-1`."""
        return f"{self.number}@{self.job}" if self.job else str(self.number)

    def spec(self, children: tuple[NodeSpec, ...] = ()) -> NodeSpec:
        """The node as `build_tree` takes it, with these children."""
        return NodeSpec(
            self.kind,
            children,
            self.name,
            self.subject,
            self.limit,
            self.timeout_us,
            self.memory,
            self.failures,
            self.origin if self.job else -1,
            self.job,
            self.number if self.number != self.origin else -1,
        )

    @property
    def label(self) -> str:
        """A short text for people: `fix_hw(2)`, `Parallel 5`, `Retry open door`."""
        if self.kind in LEAVES:
            return self.subject
        text = str(self.kind)
        if self.kind is Kind.PARALLEL:
            text += f" {self.limit}/{len(self.children)}"
            if self.failures:
                text += f", at most {self.failures - 1} failed"
        elif self.kind in (Kind.RETRY, Kind.REPEAT):
            text += f" {self.limit}" if self.limit >= 0 else " without limit"
        elif self.kind is Kind.TIMEOUT:
            text += f" {self.timeout_us / 1e6:g} s"
        if self.memory is not Memory.NONE:
            text += " with memory" if self.memory is Memory.WHILE_RUNNING else " keeping its place"
        if self.name:
            text = self.name if self.kind is Kind.SUBTREE else f"{self.name} ({text})"
        return text


@dataclass(frozen=True, slots=True)
class Tree:
    """A whole tree; `nodes[0]` is the child of the paper's root node."""

    nodes: tuple[Node, ...]

    def path(self, index: int) -> str:
        """The node's path from the root, for messages: `Sequence/Parallel[2]/fix_hw(2)`."""
        parts: list[str] = []
        while index >= 0:
            node = self.nodes[index]
            part = node.name or node.subject or str(node.kind)
            if node.parent >= 0:
                siblings = self.nodes[node.parent].children
                if len(siblings) > 1 and node.kind not in LEAVES:
                    part += f"[{siblings.index(index) + 1}]"
            parts.append(part)
            index = node.parent
        return "/".join(reversed(parts))

    def with_numbers(self, numbers: Sequence[int]) -> Tree:
        """The same nodes under these numbers, one for each; raises ValueError otherwise."""
        if len(set(numbers)) != len(self.nodes) or len(numbers) != len(self.nodes):
            raise ValueError("one number for each node of the tree is expected")
        named = zip(self.nodes, numbers, strict=True)
        return Tree(tuple(replace(node, number=number) for node, number in named))

    def actions(self) -> Iterator[Node]:
        """Action leaves in tree order."""
        return (node for node in self.nodes if node.kind is Kind.ACTION)

    def containing(self, kind: Kind) -> list[bool]:
        """For each node, whether it or any below it is of the kind."""
        found = [node.kind is kind for node in self.nodes]
        for node in reversed(self.nodes):
            found[node.index] |= any(found[child] for child in node.children)
        return found

    def spec(self, index: int = 0) -> NodeSpec:
        """The nested form of the subtree at `index`; `build_tree` takes it back."""
        node = self.nodes[index]
        return node.spec(tuple([self.spec(child) for child in node.children]))


def _check(spec: NodeSpec, path: str, depth: int) -> None:
    count = len(spec.children)
    if depth > MAX_DEPTH:
        raise TreeError(f"{path}: deeper than {MAX_DEPTH} levels")
    _check_children(spec, path, count)
    if spec.kind in CONTROLS:
        _check_control(spec, path, count)
    elif spec.memory is not Memory.NONE or spec.failures:
        raise TreeError(f"{path}: {spec.kind} has no children to remember or to count")
    if spec.kind in (Kind.RETRY, Kind.REPEAT) and (spec.limit == 0 or spec.limit < -1):
        raise TreeError(f"{path}: {spec.kind} takes a count of 1 or more, or -1 for no limit")
    if spec.kind is Kind.TIMEOUT and spec.timeout_us <= 0:
        raise TreeError(f"{path}: Timeout needs a time above 0")


def _check_children(spec: NodeSpec, path: str, count: int) -> None:
    if spec.kind in LEAVES:
        if count:
            raise TreeError(f"{path}: {spec.kind} takes no children, it has {count}")
        if not spec.subject:
            raise TreeError(f"{path}: {spec.kind} names nothing to do or to read")
    elif spec.kind is Kind.JOBS:
        if spec.limit < 1:
            raise TreeError(f"{path}: Jobs takes at least one at a time")
    elif spec.kind in CONTROLS:
        if not count:
            raise TreeError(f"{path}: {spec.kind} needs at least one child")
    elif count != 1:
        raise TreeError(f"{path}: {spec.kind} takes exactly one child, it has {count}")


def _check_control(spec: NodeSpec, path: str, count: int) -> None:
    if spec.kind is Kind.IF_THEN_ELSE and count not in (2, 3):
        raise TreeError(f"{path}: IfThenElse takes 2 or 3 children, it has {count}")
    if spec.kind is Kind.PARALLEL and not 1 <= spec.limit <= count:
        raise TreeError(f"{path}: Parallel with M={spec.limit} needs 1 <= M <= {count} children")
    if not 0 <= spec.failures <= (count if spec.kind is Kind.PARALLEL else 0):
        raise TreeError(f"{path}: {spec.kind} cannot fail at {spec.failures} failures")
    if spec.memory is Memory.UNTIL_SUCCESS and spec.kind is not Kind.SEQUENCE:
        raise TreeError(f"{path}: only a Sequence can remember until it succeeds")


def build_tree(spec: NodeSpec) -> Tree:
    """Number the nodes in depth-first preorder.

    Raises TreeError for a wrong number of children, M out of range, more than
    `MAX_DEPTH` levels or more than `MAX_NODES` nodes.
    """
    nodes: list[Node | None] = []

    def add(node: NodeSpec, parent: int, path: str, depth: int) -> int:
        here = f"{path}/{node.name or node.subject or node.kind}" if path else str(node.kind)
        _check(node, here, depth)
        index = len(nodes)
        origin = node.origin if node.origin >= 0 else index
        if index >= MAX_NODES:
            raise TreeError(f"{here}: more than {MAX_NODES} nodes")
        nodes.append(None)
        children = tuple(add(child, index, here, depth + 1) for child in node.children)
        nodes[index] = Node(
            index,
            node.kind,
            parent,
            children,
            node.name,
            node.subject,
            node.limit,
            node.timeout_us,
            node.memory,
            node.failures,
            origin,
            node.job,
            node.number if node.number >= 0 else origin,
        )
        return index

    add(spec, -1, "", 1)
    return Tree(tuple(node for node in nodes if node is not None))
