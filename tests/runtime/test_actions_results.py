"""What the result of a local task means, and the record of its work."""

from __future__ import annotations

from enum import Enum
from typing import Any

import anyio
import numpy as np
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.btcpp import NodeStatus
from mrbt_mesh.runtime.user_code import UserCodeError
from tests.support.fake_port import FakePort, cancelled_while_working, context, outcomes, run


def recording(function: Any) -> RobotProgram:
    program = RobotProgram(record_work=True)
    program.local_task("x")(function)
    return program


class Other(Enum):
    DONE = 1


@pytest.mark.parametrize(
    ("result", "success"),
    [
        (None, True),
        (True, True),
        (np.True_, True),
        (NodeStatus.SUCCESS, True),
        ({"heavy": True}, True),
        ({}, True),
        (False, False),
        (np.bool_(False), False),
        (NodeStatus.FAILURE, False),
    ],
)
async def test_results_that_mean_something(result: Any, success: bool) -> None:
    async def x(task: TaskContext) -> Any:
        return result

    port = FakePort()
    assert await run(recording(x), context(port, "x")) is success
    assert outcomes(port) == [("start", None), ("end", "success" if success else "failure")]
    assert port.conditions == (result if isinstance(result, dict) else {})


@pytest.mark.parametrize(
    "result",
    [0, 1, "failed", "", [], (True,), 0.0, object(), NodeStatus.RUNNING, Other.DONE, np.int64(1)],
)
async def test_any_other_result_is_a_failure_that_names_the_function(result: Any) -> None:
    async def x(task: TaskContext) -> Any:
        return result

    port = FakePort()
    with pytest.raises(UserCodeError) as failure:
        await run(recording(x), context(port, "x"))
    line = x.__code__.co_firstlineno
    reason = failure.value.reason
    assert reason.startswith("x returned ")
    assert f" (test_actions_results.py:{line}): return None or True for success," in reason
    assert outcomes(port) == [("start", None), ("end", "failure")]


async def test_without_the_option_nothing_is_recorded() -> None:
    program, port = RobotProgram(), FakePort()

    @program.local_task("x")
    async def x(task: TaskContext) -> None: ...

    await run(program, context(port, "x"))
    assert port.events == []


async def test_an_exception_is_recorded_as_a_failure() -> None:
    async def x(task: TaskContext) -> None:
        raise ZeroDivisionError("bug")

    port = FakePort()
    with pytest.raises(UserCodeError, match="ZeroDivisionError: bug"):
        await run(recording(x), context(port, "x"))
    assert outcomes(port) == [("start", None), ("end", "failure")]


async def test_a_cancellation_is_recorded_once_and_passes_through() -> None:
    async def x(task: TaskContext) -> None:
        await anyio.sleep_forever()

    port = FakePort()
    assert await cancelled_while_working(recording(x), context(port, "x"))
    assert outcomes(port) == [("start", None), ("cancel", None)]


async def test_the_result_of_a_task_that_was_cancelled_does_not_count() -> None:
    async def x(task: TaskContext) -> bool:
        try:
            await anyio.sleep_forever()
        except anyio.get_cancelled_exc_class():
            return True
        return False

    port = FakePort()
    assert await cancelled_while_working(recording(x), context(port, "x"))
    assert outcomes(port) == [("start", None), ("cancel", None)]


async def test_a_class_and_what_serves_every_local_task_are_recorded_too() -> None:
    program, port = RobotProgram(record_work=True), FakePort()

    @program.local_task("x")
    class X:
        async def run(self, task: TaskContext, part: str) -> None: ...

    @program.local_task("*")
    async def anything(task: TaskContext) -> None: ...

    await run(program, context(port, "x(2)", "2"))
    await run(program, context(port, "other"))
    said = [(event["local_task"], event["args"], event["event"]) for event in port.events]
    assert said == [
        ("x", ["2"], "start"),
        ("x", ["2"], "end"),
        ("other", [], "start"),
        ("other", [], "end"),
    ]
