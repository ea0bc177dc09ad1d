"""Nodes that wait."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp.executor.node import FAILURE, RUNNING, SKIPPED, SUCCESS
from tests.support.btcpp.ticked import Ticked


def test_timeout_halts_its_child() -> None:
    tree = Ticked('<Timeout msec="100"><Leaf says="RUNNING"/></Timeout>')
    assert tree.run() == [RUNNING]
    assert tree.executor.next_deadline_us == 100_000
    tree.now_ms = 99
    assert tree.run() == [RUNNING]
    tree.now_ms = 100
    assert tree.run() == [FAILURE]
    assert tree.halts == [1]
    assert tree.executor.next_deadline_us is None
    assert tree.run() == [RUNNING]
    assert tree.executor.next_deadline_us == 200_000


def test_a_timeout_ends_with_its_child_and_with_its_tree() -> None:
    tree = Ticked('<Timeout msec="100"><Leaf says="RUNNING SUCCESS RUNNING"/></Timeout>')
    assert tree.run(2) == [RUNNING, SUCCESS]
    assert tree.executor.next_deadline_us is None
    tree.run()
    tree.executor.halt()
    assert tree.executor.next_deadline_us is None
    assert tree.halts == [1]


@pytest.mark.parametrize(
    "body", ['<Delay delay_msec="50"><AlwaysSuccess/></Delay>', '<Sleep msec="50"/>']
)
def test_delay_and_sleep(body: str) -> None:
    tree = Ticked(body)
    assert tree.run(2) == [RUNNING, RUNNING]
    tree.now_ms = 50
    assert tree.run(2) == [SUCCESS, RUNNING]
    tree.now_ms = 99
    assert tree.run() == [RUNNING]
    tree.executor.halt()
    assert tree.run() == [RUNNING]
    tree.now_ms = 148
    assert tree.run() == [RUNNING]
    tree.now_ms = 149
    assert tree.run() == [SUCCESS]


def test_times_come_from_the_blackboard_and_zero_is_at_once() -> None:
    assert Ticked('<Sleep msec="{n}"/>', {"n": 0}).run() == [SUCCESS]
    assert Ticked('<Delay delay_msec="0"><AlwaysFailure/></Delay>').run() == [FAILURE]


def test_a_delay_whose_child_is_skipped_is_not_waited_for_again() -> None:
    leaf = '<Leaf says="SUCCESS" _skipIf="skip == 1"/>'
    tree = Ticked(f'<Delay delay_msec="50">{leaf}</Delay>', {"skip": 1})
    tree.run()
    tree.now_ms = 50
    assert tree.run() == [SKIPPED]
    tree.board["skip"] = 0
    assert tree.run() == [SUCCESS]
