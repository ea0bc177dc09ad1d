"""Which robot a demo kills."""

from __future__ import annotations

from unittest import mock

from mrbt_mesh.cli.guide import Guide, has_work_left, next_to_kill, replaceable
from mrbt_mesh.observer.time_at_work import time_at_work
from tests.support.runs import run_example
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


def test_the_next_one_to_kill_lives() -> None:
    script, observer = watched(WELD)
    assert next_to_kill(observer) == "A"
    script.block(["kill A", "pass 3000"])
    assert next_to_kill(observer) == "B"


def test_work_of_an_unknown_length_counts_as_long() -> None:
    script, observer = watched(WELD)
    assert has_work_left(observer, "A", 2.0, script.team.now_us)
    assert not has_work_left(observer, "B", 2.0, script.team.now_us), "it does nothing"


def test_work_that_soon_ends_is_not_long_enough() -> None:
    observer = run_example("vehicle_repair", 1, expect=None, timeout_us=9_000_000).observer
    at_work = [time_at_work(observer, robot, 9_000_000) for robot in observer.robots()]
    left = {w.robot: w.expected_s - w.for_s for w in at_work if w and w.expected_s}
    assert left
    for robot, left_s in left.items():
        assert has_work_left(observer, robot, left_s - 0.1, 9_000_000)
        assert not has_work_left(observer, robot, left_s + 0.1, 9_000_000)


def test_before_the_kill_it_is_announced() -> None:
    assert Guide(2.0).hints() == ["After 4 s this demo kills a robot at work"]


def test_a_hint_is_printed_once_also_when_the_run_is_over() -> None:
    """The kill would look like a second one."""
    guide = Guide(2.0)
    assert guide.new_hints() == guide.hints()
    assert guide.new_hints() == []
    over = run_example("vehicle_repair", 1, expect="success").observer
    running = watched(WELD)[1]
    with mock.patch.multiple(guide, _killed="B", _observer=running):
        assert guide.new_hints() == [
            "the demo has killed B",
            "in another terminal: mrbt kill A",
        ]
        with mock.patch.object(guide, "_observer", over):
            assert guide.hints() == ["the demo has killed B"]
            assert guide.new_hints() == []
