"""Base class of all nodes: statuses, pre- and post-conditions, halting, ports.

Source: BehaviorTree.CPP. Ticking is a plain call: nothing here waits, reads a clock or uses
randomness. The time is `TreeWorld.now_us`; actions are started and stopped by a list of effects.
"""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeAlias

from mrbt_mesh.btcpp.executor.blackboard import Blackboard, BlackboardError
from mrbt_mesh.btcpp.files.document import pointer
from mrbt_mesh.btcpp.scripts.evaluator import is_true, run_script
from mrbt_mesh.btcpp.scripts.script import Script, ScriptError
from mrbt_mesh.btcpp.scripts.values import (
    ValueTypeError,
    as_text,
    as_type,
    read_text,
)

# A tick that ticks more leaves than this is taken for an endless loop.
MAX_LEAVES = 20_000
MICRO = 1_000_000


class NodeStatus(enum.IntEnum):
    """BehaviorTree.CPP's node statuses, with the same numbers."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = NodeStatus
COMPLETED = (SUCCESS, FAILURE)
# Conditions checked in this order before a node starts, and the status if one holds.
_BEFORE_START = (("_failureIf", FAILURE), ("_successIf", SUCCESS), ("_skipIf", SKIPPED))


class TickError(Exception):
    """An error that ends a run: a wrong threshold, a missing entry, a failing script."""


@dataclass(frozen=True, slots=True)
class StartLeaf:
    """Start the action of node `uid`. `run` counts its starts; `inputs` are its input ports."""

    uid: int
    run: int
    name: str
    inputs: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class CancelLeaf:
    """Stop the action that was started as run `run` of node `uid`."""

    uid: int
    run: int


Effect: TypeAlias = StartLeaf | CancelLeaf
# Returns the current value of something the program maintains: a pose, a speed, a new goal.
Source: TypeAlias = Callable[[], Any]


@dataclass(frozen=True, slots=True)
class NodePlace:
    """The location of a node: its path in the tree, its file and line."""

    path: str
    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.path}"


@dataclass
class TreeWorld:
    """State shared by the nodes of one tree.

    `exact`: reproduce BehaviorTree.CPP's own oddities (docs/reference/btcpp-nodes.md). `woken_by`:
    the node that asks to be ticked again at once. `deadlines_us`: deadlines of waiting nodes, by
    uid. `given`: arguments of leaves other than ports, by type. `entries`: functions called before
    each tick for the values of entries. `stopping`: actions (uid and run) that were cancelled and
    have not stopped yet; None if stops are not reported.
    """

    exact: bool = False
    now_us: int = 0
    tick: int = 0
    leaves: int = 0
    woken_by: NodePlace | None = None
    enums: Mapping[str, int] = field(default_factory=dict)
    sources: Mapping[str, Source] = field(default_factory=dict)
    entries: Mapping[str, Source] = field(default_factory=dict)
    given: Mapping[type, Any] = field(default_factory=dict)
    effects: list[Effect] = field(default_factory=list)
    deadlines_us: dict[int, int] = field(default_factory=dict)
    stopping: set[tuple[int, int]] | None = None

    def count_leaf(self, place: NodePlace) -> None:
        """Count a tick of the leaf at `place`. Raises TickError if the tick does not end."""
        self.leaves += 1
        if self.leaves > MAX_LEAVES:
            raise TickError(
                f"{place}: more than {MAX_LEAVES:,} leaves in one tick: a loop around this node "
                "does not end"
            )


class TreeNode(ABC):
    """One node of a running tree.

    `status` is the one that its parent uses. `shown` is the status returned last, in tick
    `shown_at`. A subclass defines `tick`, and `clear` if it has state of its own.
    """

    __slots__ = (
        "board",
        "children",
        "conditions",
        "defaults",
        "name",
        "place",
        "ports",
        "reads",
        "shown",
        "shown_at",
        "status",
        "type",
        "uid",
        "world",
        "yields",
    )
    # Minimum and maximum number of children; None: no limit.
    CHILDREN: ClassVar[tuple[int, int | None]] = (0, 0)
    # Names of the sources that the program must provide for this node.
    SOURCES: ClassVar[tuple[str, ...]] = ()

    def __init__(
        self, type_name: str, world: TreeWorld, board: Blackboard, place: NodePlace, name: str = ""
    ) -> None:
        self.type = type_name
        self.name = name or type_name
        self.world = world
        self.board = board
        self.place = place
        self.children: list[TreeNode] = []
        self.ports: dict[str, str] = {}
        self.defaults: dict[str, str] = {}
        self.conditions: Mapping[str, Script] = {}
        self.uid = 0
        # True if the node may return RUNNING between two attempts (Repeat, Retry, Async*).
        self.yields = True
        self.status = IDLE
        self.shown = IDLE
        self.shown_at = 0
        self.reads: dict[str, Any] = {}
        self.clear()

    def prepare(self) -> None:
        """Called once the ports and children are known. Raises TickError for wrong ports."""

    @abstractmethod
    def tick(self) -> NodeStatus:
        """Run the node's own logic once and return its status."""

    def clear(self) -> None:
        """Reset the node's progress: before the first run, when a run ends, when it is halted."""

    def halt(self) -> None:
        """Reset the state of the run and halt the children."""
        self.clear()
        reset_all(self.children)
        self.status = IDLE

    def ended(self, status: NodeStatus) -> NodeStatus:
        """End the run with this status; children that still run are halted."""
        self.clear()
        reset_all(self.children)
        return status

    @property
    def is_anew(self) -> bool:
        """True if the current tick is the first one of a run.

        In BehaviorTree.CPP, and in an exact tree, a node that has ended but was not reset continues
        its run.
        """
        return self.status is IDLE or (self.status is not RUNNING and not self.world.exact)

    def expire(self) -> None:
        """Called when the deadline that the node set has passed."""

    def execute(self) -> NodeStatus:
        """Tick the node with its conditions, as a parent does. SKIPPED does not change `status`."""
        conditions = self.conditions
        before = self._before(conditions) if conditions else None
        if before is None:
            status = self.tick()
        else:
            # No leaf is ticked, so count the node itself: a loop above it must still end.
            self.world.count_leaf(self.place)
            status = before
        if status is IDLE:
            raise TickError(f"{self.place}: a node must not return IDLE")
        if status is not SKIPPED:
            self.status = status
        if conditions and (status is SUCCESS or status is FAILURE):
            self._run("_onSuccess" if status is SUCCESS else "_onFailure")
            self._run("_post")
        self.shown = status
        self.shown_at = self.world.tick
        return status

    def _before(self, conditions: Mapping[str, Script]) -> NodeStatus | None:
        if self.status is IDLE:
            for name, status in _BEFORE_START:
                if name in conditions and self.holds(conditions[name]):
                    return status
        elif self.status is not RUNNING:
            return None
        if "_while" in conditions and not self.holds(conditions["_while"]):
            if self.status is RUNNING:
                self.halt_node()
            return SKIPPED
        return None

    def halt_node(self) -> None:
        """Halt the node as a parent does, then run its `_onHalted` script."""
        self.halt()
        self._run("_onHalted")

    def _run(self, condition: str) -> None:
        if condition in self.conditions:
            self.evaluate(self.conditions[condition])

    def evaluate(self, script: Script) -> Any:
        """Evaluate a script on the node's blackboard. Raises TickError."""
        try:
            return run_script(script, self.board, self.world.enums)
        except (ScriptError, BlackboardError) as error:
            raise TickError(f"{self.place}: {error}, in the script {str(script)!r}") from None

    def holds(self, script: Script) -> bool:
        """Return whether a script evaluates to true. Raises TickError."""
        try:
            return is_true(self.evaluate(script))
        except ScriptError as error:
            raise TickError(f"{self.place}: {error}, in the script {str(script)!r}") from None

    # -- ports --------------------------------------------------------------------------------

    def input(self, port: str, type_name: str = "std::string") -> Any:
        """Return a port's value as this C++ type. Raises TickError if it has none."""
        if port in self.reads:
            return self.reads[port]
        text = self.ports.get(port, self.defaults.get(port))
        if text is None:
            raise TickError(f"{self.place}: port {port!r} is missing")
        key = pointer(text, port)
        if key is None:
            value = self.reads[port] = self._as(port, text, type_name)
            return value
        entry = self.board.find(key)
        if entry is None or entry.value is None:
            raise TickError(f"{self.place}: port {port!r}: the entry {key!r} has no value")
        return self._as(port, entry.value, type_name)

    def _as(self, port: str, value: Any, type_name: str) -> Any:
        try:
            return typed(value, type_name, self.world.enums)
        except ValueTypeError as error:
            raise TickError(f"{self.place}: port {port!r}: {error}") from None

    def key(self, port: str) -> str:
        """Return the name of the entry that a port points to, with or without braces.

        Raises TickError if the port is missing.
        """
        text = self.ports.get(port, "")
        if not text:
            raise TickError(f"{self.place}: port {port!r} is missing")
        return pointer(text, port) or text

    def output(self, port: str, value: Any) -> None:
        """Write a port's entry. Raises TickError if the port does not point to an entry."""
        text = self.ports.get(port, self.defaults.get(port, ""))
        key = pointer(text, port)
        if key is None:
            raise TickError(f"{self.place}: port {port!r} needs an entry to write, like {{{port}}}")
        try:
            self.board.put(key, value)
        except BlackboardError as error:
            raise TickError(f"{self.place}: port {port!r}: {error}") from None


def typed(value: Any, type_name: str, enums: Mapping[str, int]) -> Any:
    """Convert an entry's value, or a port's text, to this C++ type. Raises ValueTypeError."""
    if type_name == "BT::NodeStatus":
        if isinstance(value, str) and value in NodeStatus.__members__:
            return NodeStatus[value]
        raise ValueTypeError(f"{value!r} is not a status")
    if isinstance(value, str):
        return value if type_name == "std::string" else read_text(value, type_name, enums)
    if type_name == "std::string":
        return as_text(value) if isinstance(value, int | float) else value
    return as_type(value, type_name)


def reset(node: TreeNode) -> None:
    """Set a node to IDLE; halt it first if it is running."""
    if node.status is RUNNING:
        node.halt_node()
    node.status = IDLE


def reset_all(nodes: Sequence[TreeNode]) -> None:
    """Call `reset` for each node that is not idle."""
    for node in nodes:
        if node.status is not IDLE:
            reset(node)
