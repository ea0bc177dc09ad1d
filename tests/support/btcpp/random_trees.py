"""Random trees with a blackboard, run by BehaviorTree.CPP itself and by ours.

`Case` is one tree with its story: entries that the program sets before some ticks, and how each
action ends. `ours` and `RealTrees.told` run it and tell it tick by tick. The library runs in a
process of its own, since it may crash.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from random import Random
from typing import Any, ClassVar, Protocol

from mrbt_mesh.btcpp import BehaviorTree, BlackboardError, Leaves, NodeStatus, TickError, TreeNode
from mrbt_mesh.errors import FileError
from tests.support.real_btcpp import JsonProcess, real_btcpp

TICKS = 6
ENTRIES: dict[str, Any] = {"n": 0, "m": 2, "x": 1.5, "word": "w", "go": True}
SEEN = ("n", "m", "x", "word", "go", "k", "v", "b")
VALUES = {
    "n": (0, 1, 5),
    "m": (2, 3),
    "x": (0.5, 1.5, 3.0),
    "word": ("w", "v"),
    "go": (True, False),
}

CONDITIONS = (
    *("n == 0", "n < 2", "m == 2", "x > 1", "word == 'w'", "go", "!go", "go == true", "n == m - 2"),
    *("n + m < 4 || go", "go && x < 2", "true", "false", "k == 1", "k"),
)
SCRIPTS = (
    *("n += 1", "n = n + m", "m -= 1", "x *= 2", "word = 'v'", "word += 'a'", "go = !go", "k := 1"),
    *("k := n; n = 0", "n = 2.0", "n = '3'", "go = 'true'", "n = x", "word = 1", "k := 'a' .. n"),
    *("k += 1", "x = m", "v := 7", "go = n", "n = 'true'"),
)
ATTRIBUTES = {
    **dict.fromkeys(("_failureIf", "_successIf", "_skipIf", "_while"), CONDITIONS),
    **dict.fromkeys(("_onSuccess", "_onFailure", "_onHalted", "_post"), SCRIPTS),
}
LEAVES = (
    *("Script",) * 4,
    *("ScriptCondition",) * 4,
    *("Action",) * 5,
    *("AlwaysSuccess", "AlwaysFailure", "SetBlackboard", "UnsetBlackboard", "WasEntryUpdated"),
)
DECORATORS: dict[str, tuple[dict[str, tuple[str, ...]], ...]] = {
    "Inverter": (),
    "ForceSuccess": (),
    "ForceFailure": (),
    "KeepRunningUntilFailure": (),
    "RunOnce": ({"then_skip": ("true", "false", "{go}")},),
    "Repeat": ({"num_cycles": ("1", "2", "{m}", "{n}")},),
    "RetryUntilSuccessful": ({"num_attempts": ("1", "2", "{m}", "{x}")},),
    "Precondition": ({"if": CONDITIONS, "else": ("FAILURE", "SUCCESS", "SKIPPED", "RUNNING")},),
    "LoopInt": ({"queue": ("1;2;3", ""), "value": ("{v}", "{n}"), "if_empty": ("SKIPPED",)},),
    "LoopString": ({"queue": ("a;b", "w"), "value": ("{word}", "{v}")},),
    "SkipUnlessUpdated": ({"entry": ("{n}", "{word}", "{k}")},),
    "WaitValueUpdate": ({"entry": ("{n}", "{go}", "{k}")},),
}
CONTROLS = (
    *("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "Parallel", "IfThenElse"),
    *("SequenceWithMemory", "AsyncSequence", "AsyncFallback", "ParallelAll", "WhileDoElse"),
    "Switch2",
)

# How each start of an action ends: (after so many ticks, status).
Ends = dict[str, list[tuple[int, str]]]
Told = list[Any]


class Storied(Protocol):
    """A tree, what the program sets before each tick, and how its actions end."""

    xml: str
    sets: list[dict[str, Any]]
    ends: Ends


@dataclass
class Case:
    """One random tree and its story, from a seed."""

    seed: int
    nodes: int = 14
    ends: Ends = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.random = Random(self.seed)
        body, inner = self.node(0), self.node(2)
        self.xml = (
            '<root BTCPP_format="4" main_tree_to_execute="Main">'
            f'<BehaviorTree ID="Main">{body}</BehaviorTree>'
            f'<BehaviorTree ID="In">{inner if "SubTree" in body else "<AlwaysSuccess/>"}'
            "</BehaviorTree></root>"
        ).replace('ID="In"><SubTree', 'ID="In"><AlwaysSuccess/><SubTree')
        self.sets = [self.changes() for _ in range(TICKS)]

    def changes(self) -> dict[str, Any]:
        """What the program sets before a tick."""
        if self.random.random() < 0.5:
            return {}
        name = self.random.choice([*VALUES])
        return {name: self.random.choice(VALUES[name])}

    def node(self, depth: int) -> str:
        self.nodes -= 1
        roll = self.random.random()
        if depth == 0 or (self.nodes > 0 and depth < 5 and roll < 0.4):
            return self.control(depth)
        if self.nodes > 0 and depth < 5 and roll < 0.65:
            name = self.random.choice([*DECORATORS])
            ports = {
                port: self.random.choice(values)
                for given in DECORATORS[name]
                for port, values in given.items()
            }
            return self.element(name, ports, self.node(depth + 1))
        if depth == 1 and roll > 0.92:
            given = self.random.choice(
                [{"n": "{n}", "go": "{go}"}, {"_autoremap": "true"}, {"m": "{n}"}, {}]
            )
            return self.element("SubTree", {"ID": "In"} | given)
        return self.leaf()

    def control(self, depth: int) -> str:
        name = self.random.choice(CONTROLS)
        count = self.random.randint(1, 3)
        ports: dict[str, str] = {}
        if name in ("IfThenElse", "WhileDoElse"):
            count = self.random.randint(2, 3)
        elif name == "Switch2":
            count = 3
            ports = {
                "variable": self.random.choice(["{word}", "{n}", "{m}", "w"]),
                "case_1": self.random.choice(["w", "0", "2"]),
                "case_2": self.random.choice(["v", "1", "3"]),
            }
        elif name == "Parallel":
            ports = {
                "success_count": str(self.random.choice([-1, 1, count])),
                "failure_count": str(self.random.choice([1, count])),
            }
        elif name == "ParallelAll":
            ports = {"max_failures": str(self.random.randint(1, count))}
        children = [self.node(depth + 1) for _ in range(count)]
        return self.element(name, ports, "".join(children))

    def leaf(self) -> str:
        name = self.random.choice(LEAVES)
        ports: dict[str, str] = {}
        if name == "Script":
            ports = {"code": self.random.choice(SCRIPTS)}
        elif name == "ScriptCondition":
            ports = {"code": self.random.choice(CONDITIONS)}
        elif name == "SetBlackboard":
            # No entry without a type: the library 4.8.2 loses a text that is to be written there.
            values = ["1", "w", "{n}", "{x}"]
            keys = ["n", "m", "b"]
            ports = {
                "value": self.random.choice(values),
                "output_key": self.random.choice(keys),
            }
        elif name == "UnsetBlackboard":
            ports = {"key": self.random.choice(["k", "v"])}
        elif name == "WasEntryUpdated":
            ports = {"entry": self.random.choice(["{n}", "{k}", "{word}"])}
        elif name == "Action":
            name = f"a{len(self.ends)}"
            self.ends[name] = [
                (self.random.randint(0, 3), self.random.choice(["SUCCESS", "SUCCESS", "FAILURE"]))
                for _ in range(3)
            ]
        return self.element(name, ports)

    def element(self, name: str, ports: dict[str, str], inside: str = "") -> str:
        while self.random.random() < 0.12:
            attribute = self.random.choice([*ATTRIBUTES])
            ports[attribute] = self.random.choice(ATTRIBUTES[attribute])
        given = "".join(f' {key}="{_escaped(value)}"' for key, value in ports.items())
        return f"<{name}{given}>{inside}</{name}>" if inside else f"<{name}{given}/>"


def _escaped(value: str) -> str:
    return value.replace("&", "&amp;").replace("<", "&lt;")


class Story:
    """What actions do, by name; the same for the library's and for ours."""

    def __init__(self, ends: Ends) -> None:
        self.ends = ends
        self.starts = dict.fromkeys(ends, 0)
        self.left = dict.fromkeys(ends, 0)
        self.log: list[str] = []

    def start(self, name: str) -> str:
        self.log.append(f"{name} starts")
        self.starts[name] += 1
        return self.step(name, self._end(name)[0])

    def go_on(self, name: str) -> str:
        return self.step(name, self.left[name] - 1)

    def step(self, name: str, left: int) -> str:
        self.left[name] = left
        return "RUNNING" if left > 0 else self._end(name)[1]

    def halt(self, name: str) -> None:
        self.log.append(f"{name} is halted")

    def _end(self, name: str) -> tuple[int, str]:
        ways = self.ends[name]
        return ways[(self.starts[name] - 1) % len(ways)]

    def told(self) -> list[str]:
        """What has happened since this was asked last."""
        told, self.log = self.log, []
        return told


def ours(case: Storied, entries: Mapping[str, Any] = ENTRIES, seen: Iterable[str] = SEEN) -> Told:
    """Per tick: the root's status, what actions did, entries; or an error, which ends it."""
    story = Story(case.ends)

    class Act(TreeNode):
        CHILDREN: ClassVar[tuple[int, int | None]] = (0, 0)

        def tick(self) -> NodeStatus:
            if self.status is NodeStatus.IDLE:
                return NodeStatus[story.start(self.type)]
            if self.status is NodeStatus.RUNNING:
                return NodeStatus[story.go_on(self.type)]
            return self.status

        def halt(self) -> None:
            if self.status is NodeStatus.RUNNING:
                story.halt(self.type)
            super().halt()

    leaves = Leaves()
    for name in case.ends:
        leaves.node(name)(Act)
    told: Told = []
    try:
        tree = BehaviorTree.from_text(case.xml, None, leaves, exact=True)
        for name, value in entries.items():
            tree.blackboard[name] = value
        executor = tree.executor
    except (FileError, BlackboardError) as error:
        return ["not loaded", str(error)]
    for changes in case.sets:
        try:
            for name, value in changes.items():
                tree.blackboard[name] = value
            status = executor.tick(0)
        except (TickError, BlackboardError) as error:
            return [*told, "error", str(error)]
        found = {name: tree.blackboard.get(name) for name in seen}
        shown = {name: _shown(value) for name, value in found.items() if value is not None}
        told.append([status.name, story.told(), shown])
    return told


def _shown(value: Any) -> str:
    if isinstance(value, str):
        return value
    return f"{value:f}" if isinstance(value, float) else str(int(value))


_SERVER = f"""
import json, os, sys
sys.path.insert(0, {str(sys.path[0])!r})
import behaviortreepy as btcpp
from tests.support.btcpp.random_trees import SEEN, ENTRIES, Story
answers = os.fdopen(os.dup(1), "w")
quiet = os.open(os.devnull, os.O_WRONLY)
os.dup2(quiet, 1)
os.dup2(quiet, 2)
SETTERS = {{bool: "set_bool", int: "set_int", float: "set_double", str: "set_string"}}
def put(board, values):
    for name, value in values.items():
        getattr(board, SETTERS[type(value)])(name, value)
# Its nodes point into the factory, which has to live longer than its tree.
trees, factories = [], []
def told(asked):
    story = Story(asked["ends"])
    trees.clear()
    factories[:] = [btcpp.BehaviorTreeFactory()]
    (factory,), board = factories, btcpp.Blackboard.create()
    status = btcpp.NodeStatus
    for name in asked["ends"]:
        factory.register_simple_stateful_action(
            name,
            lambda node, name=name: getattr(status, story.start(name)),
            lambda node, name=name: getattr(status, story.go_on(name)),
            lambda node, name=name: story.halt(name))
    try:
        put(board, ENTRIES)
        trees.append(factory.create_tree_from_text(asked["xml"], board))
    except Exception as error:
        return ["not loaded", str(error)]
    found = []
    for changes in asked["sets"]:
        try:
            put(board, changes)
            ended = trees[0].tick_exactly_once().name
        except Exception as error:
            return [*found, "error", str(error)]
        entries = {{}}
        for name in SEEN:
            try:
                entries[name] = board.get_string(name)
            except Exception:
                continue
        found.append([ended, story.told(), entries])
    return found
for line in sys.stdin:
    answers.write(json.dumps(told(json.loads(line))) + "\\n")
    answers.flush()
"""


class RealTrees:
    """The library in a process of its own."""

    def __init__(self, process: JsonProcess) -> None:
        self._process = process

    def told(self, case: Case) -> Told:
        """As `ours`."""
        is_fresh = not self._process.is_running
        answer = self._process.ask({"xml": case.xml, "ends": case.ends, "sets": case.sets})
        if answer is not None:
            return list(answer)
        # It crashes now and then in a process that has run other trees, and where it refuses some.
        return ["not loaded", "it crashed"] if is_fresh else self.told(case)


@contextmanager
def real_trees() -> Iterator[RealTrees]:
    """The library; skips the test where it is not installed."""
    with real_btcpp(_SERVER) as process:
        yield RealTrees(process)
