"""Which robot a demo kills."""

from __future__ import annotations

from mrbt_mesh.cli.guide import replaceable
from tests.support.watched import ALONE, COVER, WELD, watched


def test_a_robot_at_work_whose_task_another_one_can_do() -> None:
    _, observer = watched(WELD)
    assert list(replaceable(observer)) == ["A"]


def test_no_robot_that_nobody_can_replace() -> None:
    _, observer = watched(ALONE)
    assert list(replaceable(observer)) == []


def test_no_robot_that_a_later_task_needs() -> None:
    _, observer = watched(COVER)
    assert list(replaceable(observer)) == []
