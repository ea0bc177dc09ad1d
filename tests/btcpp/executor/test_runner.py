"""Running a tree in an event loop, on a virtual clock."""

from __future__ import annotations

import asyncio
from typing import Any

import anyio
import pytest

from mrbt_mesh.btcpp import BehaviorTree, NodeStatus, Out, TaskFailedError, TickError
from tests.support.btcpp.running import in_virtual_time


class Robot:
    """Does what trees ask for: each action takes a second; notes what becomes of it."""

    def __init__(self, body: str, **options: Any) -> None:
        text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
        self.tree = BehaviorTree.from_text(text, **options)
        self.told: list[str] = []
        self.answers = {"ok": True}
        self.tree.action("Act")(self.act)
        self.tree.condition("Ok")(lambda: self.answers["ok"])

    async def act(self, what: str, takes_s: float = 1.0) -> bool:
        self.told.append(f"{what} begins at {anyio.current_time():g}")
        try:
            await anyio.sleep(takes_s)
        except anyio.get_cancelled_exc_class():
            with anyio.CancelScope(shield=True):
                await anyio.sleep(0.25)  # it takes time to stop
            self.told.append(f"{what} has stopped at {anyio.current_time():g}")
            raise
        self.told.append(f"{what} ends at {anyio.current_time():g}")
        return what != "fail"

    def run(self, **options: Any) -> tuple[NodeStatus, float]:
        return in_virtual_time(lambda: self.tree.run(**options))


def act(what: str, takes_s: float = 1.0) -> str:
    return f'<Act what="{what}" takes_s="{takes_s}"/>'


def test_actions_follow_one_another_without_waiting_for_the_rate() -> None:
    robot = Robot(f"<Sequence>{act('a')}{act('b')}</Sequence>")
    assert robot.run(rate_hz=0.001) == (NodeStatus.SUCCESS, 2.0)
    assert robot.told == ["a begins at 0", "a ends at 1", "b begins at 1", "b ends at 2"]


def test_a_timeout_ends_by_the_clock_and_waits_until_its_action_has_stopped() -> None:
    body = f'<Fallback><Timeout msec="400">{act("a")}</Timeout>{act("b")}</Fallback>'
    robot = Robot(body)
    assert robot.run(rate_hz=0) == (NodeStatus.SUCCESS, 1.65)
    assert robot.told == [
        "a begins at 0",
        "a has stopped at 0.65",
        "b begins at 0.65",
        "b ends at 1.65",
    ]


def test_a_tree_that_polls_lets_time_go_on_and_is_named(caplog: pytest.LogCaptureFixture) -> None:
    """Also without a rate; a loop that ends is not slowed down."""
    poll = '<RetryUntilSuccessful num_attempts="-1"><Ok/></RetryUntilSuccessful>'
    loop = '<Repeat num_cycles="9000"><Script code="n := 1"/></Repeat>'
    robot = Robot(f"<Sequence>{loop}{poll}</Sequence>")
    robot.answers["ok"] = False

    async def program() -> NodeStatus:
        with anyio.move_on_after(5) as timeout:
            await robot.tree.run(rate_hz=0)
        assert timeout.cancelled_caught
        robot.answers["ok"] = True
        return await robot.tree.run()

    assert in_virtual_time(program) == (NodeStatus.SUCCESS, 5.0)
    (message,) = caplog.messages
    assert message.startswith("tree.xml:1: Main/Sequence/RetryUntilSuccessful: ticked 10,000 times")


def test_conditions_are_asked_at_the_rate() -> None:
    robot = Robot(f"<ReactiveSequence><Ok/>{act('a', 10)}</ReactiveSequence>")

    async def program() -> NodeStatus:
        async with anyio.create_task_group() as group:

            async def turn() -> None:
                await anyio.sleep(0.99)
                robot.answers["ok"] = False

            group.start_soon(turn)
            return await robot.tree.run(rate_hz=2)

    assert in_virtual_time(program) == (NodeStatus.FAILURE, 1.25)
    assert robot.told == ["a begins at 0", "a has stopped at 1.25"]


def test_an_entry_that_a_program_sets_is_heard_at_once() -> None:
    robot = Robot('<WaitValueUpdate entry="{go}"><AlwaysSuccess/></WaitValueUpdate>')

    async def program() -> NodeStatus:
        async with anyio.create_task_group() as group:

            async def turn() -> None:
                await anyio.sleep(3)
                robot.tree.blackboard["go"] = 1

            group.start_soon(turn)
            return await robot.tree.run(rate_hz=0)

    assert in_virtual_time(program) == (NodeStatus.SUCCESS, 3.0)


def test_cancelled_it_halts_its_tree_and_waits_for_its_actions() -> None:
    robot = Robot(f'<Parallel _onHalted="halted := 1">{act("a")}{act("b")}</Parallel>')

    async def program() -> None:
        with anyio.move_on_after(0.5):
            await robot.tree.run()

    assert in_virtual_time(program) == (None, 0.75)
    assert sorted(robot.told[2:]) == ["a has stopped at 0.75", "b has stopped at 0.75"]
    assert robot.tree.blackboard["halted"] == 1
    assert robot.run() == (NodeStatus.SUCCESS, 1.0)  # it can be run again


def test_a_loop_that_asks_to_be_ticked_at_once_leaves_others_their_turn() -> None:
    robot = Robot('<Repeat num_cycles="-1"><Script code="n += 1"/></Repeat>')
    robot.tree.blackboard["n"] = 0

    async def program() -> None:
        async with anyio.create_task_group() as group:

            async def stop() -> None:
                while robot.tree.blackboard["n"] < 50:
                    await anyio.lowlevel.checkpoint()
                group.cancel_scope.cancel()

            group.start_soon(stop)
            await robot.tree.run()

    in_virtual_time(program)
    assert robot.tree.blackboard["n"] >= 50


def test_failures_have_reasons_and_other_errors_end_the_run() -> None:
    robot = Robot(f"<Parallel failure_count='2' success_count='2'>{act('a')}<Grip/></Parallel>")

    @robot.tree.action("Grip")
    async def grip() -> None:
        raise error

    error: Exception = TaskFailedError("nothing to hold")
    assert robot.run()[0] is NodeStatus.FAILURE
    assert [view.reason for view in robot.tree.view() if view.type == "Grip"] == ["nothing to hold"]
    error = ZeroDivisionError("in the driver")
    with pytest.raises(ZeroDivisionError, match="in the driver"):
        robot.run()
    assert robot.told[-1] == "a has stopped at 0.25"


@pytest.mark.parametrize("error", [SystemExit(3), asyncio.CancelledError(), GeneratorExit()])
def test_a_leaf_that_exits_or_cancels_ends_the_run_with_that(error: BaseException) -> None:
    robot = Robot("<Odd/>")

    @robot.tree.action("Odd")
    async def odd() -> None:
        raise error

    caught: list[BaseException] = []

    async def run() -> None:
        try:
            await robot.tree.run()
        except BaseException as found:
            caught.append(found)

    anyio.run(run)
    assert caught == [error]


def test_a_result_that_is_no_status_is_told() -> None:
    robot = Robot("<Odd/>")

    @robot.tree.action("Odd")
    async def odd() -> int:
        return 7

    with pytest.raises(TickError, match="Main/Odd: Odd returned 7, which is not a status"):
        robot.run()


def test_an_output_is_written_while_its_action_runs_and_not_when_it_was_cancelled() -> None:
    say = '<Say text="{said}"/>'
    robot = Robot(f'<Sequence><Timeout msec="1500">{say}</Timeout></Sequence>')

    @robot.tree.action("Say")
    async def say_it(text: Out[str]) -> None:
        with anyio.CancelScope(shield=True):
            for number in range(3):
                text.set(f"word {number}")
                await anyio.sleep(1)

    assert robot.run() == (NodeStatus.FAILURE, 3.0)
    assert robot.tree.blackboard["said"] == "word 1"


def test_one_run_at_a_time() -> None:
    robot = Robot(act("a"))

    async def program() -> None:
        async with anyio.create_task_group() as group:
            group.start_soon(robot.tree.run)
            await anyio.sleep(0.1)
            with pytest.raises(RuntimeError, match="is running already"):
                await robot.tree.run()

    assert in_virtual_time(program)[1] == 1.0


def test_watchers_see_every_tick() -> None:
    robot = Robot(f"<Sequence>{act('a')}{act('fail')}</Sequence>")
    seen: list[list[str]] = []
    robot.tree.watch(lambda: seen.append([view.status.name for view in robot.tree.view()]))
    assert robot.run(rate_hz=0)[0] is NodeStatus.FAILURE
    assert seen == [
        ["RUNNING", "RUNNING", "IDLE"],
        ["RUNNING", "SUCCESS", "RUNNING"],
        ["FAILURE", "IDLE", "FAILURE"],
    ]


@pytest.mark.parametrize("exact", [False, True])
def test_a_tree_that_has_ended_is_not_halted(exact: bool) -> None:
    body = f'<Sequence _onHalted="halts += 1">{act("a")}<Sleep msec="5"/></Sequence>'
    robot = Robot(body, exact=exact)
    robot.tree.blackboard["halts"] = 0
    assert robot.run()[0] is NodeStatus.SUCCESS
    assert robot.tree.blackboard["halts"] == 0
