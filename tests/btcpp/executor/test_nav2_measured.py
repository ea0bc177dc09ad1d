"""Trees with Nav2's nodes against those of Nav2 itself: tests/data/btcpp/README.md."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus
from mrbt_mesh.btcpp.executor.node import StartLeaf
from mrbt_mesh.btcpp.executor.tree_executor import TreeExecutor
from tests.support.paths import ROOT

DATA = ROOT / "tests" / "data" / "btcpp" / "nav2.jsonl.gz"
LETTERS = "IRSFK"
ENDED = {"S": NodeStatus.SUCCESS, "F": NodeStatus.FAILURE}
# Where a tree that is not exact may do something else: docs/reference/btcpp-nodes.md.
YIELDS = re.compile(r"Repeat|RetryUntilSuccessful|Async|SequenceWithMemory")
ODD = re.compile(r"<IfThenElse|<PauseResumeController")
DIFFERENT = 21


@dataclass
class Measured:
    """A tree with its story, and what the library did."""

    id: str
    xml: str
    ends: dict[str, list[str]]
    step_ms: int
    before: dict[str, list[list[Any]]]
    told: list[list[Any]]
    left: dict[str, Any]


class Robot:
    """The functions of the leaves, by the story of one tree."""

    def __init__(self, case: Measured) -> None:
        self.case = case
        self.calls: list[str] = []
        self.asked: dict[str, int] = {}
        self.running: dict[tuple[int, int], tuple[str, int, str]] = {}
        self.told: dict[str, Any] = {"pose": 0.0, "speed": 0.0}
        self.leaves = Leaves()
        self.leaves.source("robot_pose")(lambda: (self.told["pose"], 0.0))
        self.leaves.source("robot_speed")(lambda: self.told["speed"])
        self.leaves.action("Act")(self._act)
        self.leaves.action("Now")(self._now)
        self.leaves.condition("Cond")(self._now)

    async def _act(self, task: str) -> None:
        raise AssertionError("the test carries out actions itself")

    def _now(self, task: str) -> bool:
        self.calls.append(task)
        return self._next(task, "S") == "S"

    def _next(self, name: str, otherwise: str) -> str:
        ends = self.case.ends.get(name, [otherwise])
        count = self.asked[name] = self.asked.get(name, 0) + 1
        return ends[(count - 1) % len(ends)]

    def end(self, executor: TreeExecutor, tick: int) -> None:
        """End the actions whose time is over."""
        for (uid, run), (_, end, status) in [*self.running.items()]:
            if end <= tick:
                del self.running[uid, run]
                executor.ended(uid, run, ENDED[status])

    def follow(self, executor: TreeExecutor, tick: int) -> list[str]:
        """What begins and stops."""
        found = []
        for effect in executor.take_effects():
            if isinstance(effect, StartLeaf):
                name = effect.inputs["task"]
                ticks, status = self._next(name, "1S")
                self.running[effect.uid, effect.run] = (name, tick + int(ticks), status)
                found.append(f"start {name}")
            else:
                found.append(f"halt {self.running.pop((effect.uid, effect.run))[0]}")
        return found


def run(case: Measured, exact: bool) -> tuple[list[list[Any]], Mapping[str, Any]]:
    """Per tick the root's status, all nodes', calls, what begins and stops; entries at the end."""
    robot = Robot(case)
    tree = BehaviorTree.from_text(case.xml, None, robot.leaves, exact=exact)
    executor = tree.executor
    told: list[list[Any]] = []
    for tick in range(len(case.told)):
        robot.end(executor, tick)
        for what, *values in case.before.get(str(tick), []):
            if what == "halt":
                executor.halt()
            elif what == "set":
                tree.blackboard[values[0]] = values[1]
            else:
                robot.told[what] = values[0]
        robot.calls = []
        status = executor.tick(tick * case.step_ms * 1_000)
        inner = "".join(LETTERS[node.status] for node in executor.nodes)
        told.append([LETTERS[status], inner, robot.calls, robot.follow(executor, tick)])
    return told, {name: tree.blackboard.get(name) for name in case.left}


def cases() -> list[Measured]:
    with gzip.open(DATA, "rt", encoding="utf-8") as lines:
        return [Measured(**json.loads(line)) for line in lines]


def test_an_exact_tree_does_what_nav2_does() -> None:
    measured = cases()
    assert len(measured) == 734
    for case in measured:
        assert run(case, exact=True) == (case.told, case.left), (case.id, case.xml)


def test_other_trees_differ_in_the_named_oddities_alone() -> None:
    different = 0
    for case in cases():
        if ["halt"] in [change for changes in case.before.values() for change in changes]:
            continue
        if run(case, exact=False)[0] != case.told:
            different += 1
            guarded = "Reactive" in case.xml and YIELDS.search(case.xml)
            assert guarded or ODD.search(case.xml), (case.id, case.xml)
    assert different == DIFFERENT
