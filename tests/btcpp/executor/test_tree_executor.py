"""The executor: time and outcomes in, effects out."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus, TickError
from mrbt_mesh.btcpp.executor.node import CancelLeaf, StartLeaf
from mrbt_mesh.btcpp.executor.tree_executor import TreeExecutor
from tests.support.btcpp.ticked import Ticked


async def _act(what: str = "") -> None: ...


def executor_of(body: str) -> TreeExecutor:
    leaves = Leaves()
    leaves.action("Act")(_act)
    leaves.condition("Ok")(lambda: True)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return BehaviorTree.from_text(text, leaves=leaves).executor


def test_actions_are_started_once_and_end_by_what_is_told() -> None:
    executor = executor_of('<Sequence><Act what="a"/><Act what="b"/></Sequence>')
    assert executor.tick(0) is NodeStatus.RUNNING
    assert executor.take_effects() == [StartLeaf(2, 1, "Act", {"what": "a"})]
    assert executor.tick(1) is NodeStatus.RUNNING
    assert executor.take_effects() == []
    assert executor.ended(2, 1, NodeStatus.SUCCESS)
    assert executor.tick(2) is NodeStatus.RUNNING
    assert executor.take_effects() == [StartLeaf(3, 1, "Act", {"what": "b"})]
    assert executor.ended(3, 1, NodeStatus.FAILURE)
    assert executor.tick(3) is NodeStatus.FAILURE
    assert executor.status is NodeStatus.FAILURE
    assert list(executor.statuses()) == [3, 0, 3]


def test_what_is_halted_is_cancelled_and_its_end_is_ignored() -> None:
    executor = executor_of('<Timeout msec="1"><Act/></Timeout>')
    executor.tick(0)
    executor.take_effects()
    assert executor.tick(1_000) is NodeStatus.FAILURE
    assert executor.take_effects() == [CancelLeaf(2, 1)]
    assert not executor.ended(2, 1, NodeStatus.SUCCESS)
    executor.tick(2_000)
    assert executor.take_effects() == [StartLeaf(2, 2, "Act", {})]
    assert not executor.ended(2, 1, NodeStatus.SUCCESS)
    executor.halt()
    assert executor.take_effects() == [CancelLeaf(2, 2)]


def test_what_has_ended_is_not_cancelled() -> None:
    executor = executor_of("<Parallel success_count='1' failure_count='2'><Act/><Act/></Parallel>")
    executor.tick(0)
    executor.take_effects()
    for uid in (2, 3):
        executor.ended(uid, 1, NodeStatus.SUCCESS)
    assert executor.tick(1) is NodeStatus.SUCCESS
    assert executor.take_effects() == []


def test_only_leaves_are_leaves() -> None:
    executor = executor_of("<Sequence><Act/></Sequence>")
    assert executor.leaf(2).type == "Act"
    with pytest.raises(KeyError, match="node 1 is not a leaf"):
        executor.leaf(1)
    assert not executor.ended(1, 1, NodeStatus.SUCCESS)


def test_what_the_program_says_of_entries_is_there_before_each_tick() -> None:
    """What it says once more is no write, and None says nothing."""
    charge: list[Any] = [None]
    body = '<Sequence><WasEntryUpdated entry="{charge}"/><SubTree ID="In"/></Sequence>'
    inner = '<BehaviorTree ID="In"><Note what="{@charge}"/></BehaviorTree>'
    tree = Ticked(body, {"charge": 7}, trees=inner, says={"@charge": lambda: charge[0]})
    found = []
    for charge[0] in (None, 8, 8, 9):
        found += tree.run()
    assert [status is NodeStatus.SUCCESS for status in found] == [True, True, False, True]
    assert tree.seen == [7, 8, 9]


def test_what_an_entry_cannot_hold_is_told() -> None:
    tree = Ticked('<Timeout msec="{limit}"><AlwaysSuccess/></Timeout>', says={"limit": lambda: "x"})
    with pytest.raises(TickError, match="the entry 'limit' is of type unsigned int: the text 'x'"):
        tree.run()
