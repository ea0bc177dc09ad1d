"""The interpreter's nodes, its world, and what BehaviorTree.CPP does around every tick."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.formats.btcpp.script_eval import evaluate

MAX_LOOPS = 10_000


class Status(enum.IntEnum):
    """BehaviorTree.CPP's node statuses."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


class TickError(Exception):
    """What BehaviorTree.CPP throws while ticking: a wrong threshold, an IDLE child, ..."""


IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = Status
COMPLETED = (SUCCESS, FAILURE)
Script = str | Callable[["Blackboard"], Any]


class Blackboard(dict[str, Any]):
    """Entries, and how often each was written."""

    def __init__(self, *args: Any, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        self.writes: dict[str, int] = dict.fromkeys(self, 1)

    def __setitem__(self, key: str, value: Any) -> None:
        self.writes[key] = self.writes.get(key, 0) + 1
        super().__setitem__(key, value)


@dataclass
class World:
    """What is around a tree: blackboard, clock, and how scripts are evaluated.

    With `yields`, Retry and Repeat return RUNNING between attempts whose child ended in one tick,
    and ask to be ticked again at once, as BehaviorTree.CPP's do; without it they go on looping.
    AsyncSequence and AsyncFallback always yield. `woken` says that somebody did.
    """

    blackboard: Blackboard = field(default_factory=Blackboard)
    now_ms: int = 0
    yields: bool = False
    evaluate: Callable[[str, Blackboard], Any] = evaluate
    woken: bool = False

    def run(self, script: Script) -> Any:
        """The value of a script."""
        if callable(script):
            return script(self.blackboard)
        return self.evaluate(script, self.blackboard)


# Attributes: what a node is, and the run state that BehaviorTree.CPP's nodes keep in fields.
@dataclass(eq=False)
class Node:
    """One node with its run state.

    `ports` hold constants or blackboard pointers such as `{key}`. `conditions` are the pre- and
    post-conditions by attribute name (`_skipIf`, ...). An `Action` or `Condition` has a `script`:
    its status at each of its ticks (the last one repeats), or a function.
    """

    kind: str
    children: Sequence[Node] = ()
    ports: dict[str, Any] = field(default_factory=dict)
    conditions: dict[str, Script] = field(default_factory=dict)
    script: Sequence[Status] | Callable[[], Status] = ()
    name: str = ""
    status: Status = IDLE
    index: int = 0
    count: int = 0
    skipped: int = 0
    ticks: int = 0
    halts: int = 0
    memory: dict[str, Any] = field(default_factory=dict)


def leaf(statuses: str, **conditions: Script) -> Node:
    """An action whose ticks return, in turn, the statuses that `statuses` lists."""
    return Node("Action", script=[Status[word] for word in statuses.split()], conditions=conditions)


def execute(node: Node, world: World) -> Status:
    """Tick one node: preconditions, the tick itself, postconditions. SKIPPED leaves it IDLE."""
    status = _precondition(node, world)
    if status is None:
        status = Status(TICKS[_family(node.kind)](node, world))
    if status is IDLE:
        raise TickError(f"{node.kind} returned IDLE")
    if status in COMPLETED:
        _run_post(node, "_onSuccess" if status is SUCCESS else "_onFailure", world)
        _run_post(node, "_post", world)
    node.status = IDLE if status is SKIPPED else status
    return status


def _family(kind: str) -> str:
    if kind.startswith("Switch") and kind[6:] in {"2", "3", "4", "5", "6"}:
        return "Switch"
    if kind not in TICKS:
        raise TickError(f"unknown node type {kind}")
    return kind


def _precondition(node: Node, world: World) -> Status | None:
    if node.status is not RUNNING and node.status is not IDLE:
        return None
    if node.status is IDLE:
        for attribute, status in PRECONDITIONS:
            if attribute in node.conditions and world.run(node.conditions[attribute]):
                return status
    if "_while" in node.conditions and not world.run(node.conditions["_while"]):
        if node.status is RUNNING:
            _halt(node, world)
        return SKIPPED
    return None


PRECONDITIONS = (("_failureIf", FAILURE), ("_successIf", SUCCESS), ("_skipIf", SKIPPED))


def _run_post(node: Node, attribute: str, world: World) -> None:
    if attribute in node.conditions:
        world.run(node.conditions[attribute])


def _halt(node: Node, world: World) -> None:
    node.halts += 1
    if node.kind in BEFORE_HALT:
        BEFORE_HALT[node.kind](node, world)
    for child in node.children:
        reset(child, world)
    if node.kind != "SequenceWithMemory":
        node.index = node.skipped = 0
    node.count = 0
    for key in [key for key in node.memory if key not in KEPT_WHEN_HALTED]:
        del node.memory[key]
    node.status = IDLE
    _run_post(node, "_onHalted", world)


KEPT_WHEN_HALTED = ("once", "seen")


def reset(node: Node, world: World) -> None:
    """Back to IDLE, halted first if it was running."""
    if node.status is RUNNING:
        _halt(node, world)
    node.status = IDLE


def reset_all(children: Sequence[Node], world: World) -> None:
    for child in children:
        reset(child, world)


def port(node: Node, name: str, default: Any, world: World) -> Any:
    """A port's value, blackboard pointers followed; `default` if there is none."""
    value = node.ports.get(name)
    if isinstance(value, str) and len(value) >= 3 and value[0] == "{" and value[-1] == "}":
        value = world.blackboard.get(value[1:-1])
    return default if value is None else value


# Filled by the modules of controls, decorators and leaves.
TICKS: dict[str, Callable[[Node, World], Status]] = {}
BEFORE_HALT: dict[str, Callable[[Node, World], None]] = {}


def is_true(value: object) -> bool:
    """A boolean port's value as BehaviorTree.CPP reads it."""
    return str(value) in ("1", "true", "True", "TRUE")
