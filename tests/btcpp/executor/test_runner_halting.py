"""Leaves that take time to stop when they are halted, or never do, on a virtual clock."""

from __future__ import annotations

import asyncio
import contextlib
import logging

import anyio
import pytest

from mrbt_mesh.btcpp import BehaviorTree, NodeStatus, TickError
from mrbt_mesh.btcpp.executor.runner import STOP_LIMIT_S
from tests.support.btcpp.running import in_virtual_time

TIMED = '<Fallback><Timeout msec="1000"><Brake/></Timeout><Turn/></Fallback>'
REACTIVE = "<Fallback><ReactiveSequence><Ok/><Brake/></ReactiveSequence><Turn/></Fallback>"
PARALLEL = (
    '<Fallback><Parallel failure_count="1"><Timeout msec="1000"><Brake/></Timeout><Slow/>'
    "</Parallel><Sequence><Ok/><Turn/></Sequence><Turn/></Fallback>"
)


class Robot:
    """Its brake takes `stop_s` to stop; whether it stands is asked by what moves it."""

    def __init__(self, body: str, stop_s: float) -> None:
        text = f'<root BTCPP_format="4"><BehaviorTree ID="M">{body}</BehaviorTree></root>'
        self.tree = tree = BehaviorTree.from_text(text)
        self.moving = 0
        self.turned_at: list[float] = []
        self.overlaps = 0
        self.stop_s = stop_s
        tree.action("Brake")(self.brake)
        tree.action("Slow")(self.brake)
        tree.action("Turn")(self.turn)
        tree.condition("Ok")(lambda: anyio.current_time() < 1)

    async def brake(self) -> None:
        self.moving += 1
        try:
            await anyio.sleep(60)
        finally:
            with anyio.CancelScope(shield=True):
                await anyio.sleep(self.stop_s)
            self.moving -= 1

    def turn(self) -> None:
        self.overlaps += self.moving
        self.turned_at.append(anyio.current_time())


@pytest.mark.parametrize("body", [TIMED, REACTIVE, PARALLEL, TIMED.replace("Turn/", "Later/")])
@pytest.mark.parametrize("stop_s", [0.0, 0.5, 3.0])
def test_the_next_action_begins_when_the_halted_one_has_stopped(body: str, stop_s: float) -> None:
    robot = Robot(body, stop_s)

    @robot.tree.action("Later")
    async def later() -> None:
        robot.turn()

    assert in_virtual_time(robot.tree.run)[0] is NodeStatus.SUCCESS
    assert robot.overlaps == 0
    assert len(robot.turned_at) == 1
    assert robot.turned_at[0] >= 1 + stop_s


def test_one_that_does_not_stop_is_named_and_holds_the_next(
    caplog: pytest.LogCaptureFixture,
) -> None:
    robot = Robot(TIMED, STOP_LIMIT_S + 10)
    with caplog.at_level(logging.WARNING):
        assert in_virtual_time(robot.tree.run)[0] is NodeStatus.SUCCESS
    assert robot.overlaps == 0
    (told,) = caplog.messages
    assert (
        "M/Fallback/Timeout/Brake: Brake still runs 5 s after it was halted (test_runner_" in told
    )


def test_a_tree_can_be_left_whose_leaf_never_ends(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot("<Brake/>", 10_000)

    async def main() -> float:
        with anyio.move_on_after(1) as scope:
            await robot.tree.run()
        assert scope.cancel_called
        return anyio.current_time()

    with caplog.at_level(logging.WARNING), pytest.raises(TickError, match="was given up"):
        in_virtual_time(main)
    assert robot.moving == 1
    assert "Brake still runs 5 s after" in caplog.text


@pytest.mark.parametrize("body", ["<Deaf/>", '<Timeout msec="1000"><Deaf/></Timeout>'])
def test_a_leaf_that_swallows_its_cancellation_is_ended(body: str) -> None:
    robot = Robot(body, 0)

    @robot.tree.action("Deaf")
    async def deaf() -> None:
        while True:
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.sleep(0.1)

    async def main() -> None:
        with anyio.move_on_after(2):
            await robot.tree.run()

    with pytest.raises(
        TickError, match=r"Deaf goes on after 1000 cancellations \(test_runner_halt"
    ):
        in_virtual_time(main)
