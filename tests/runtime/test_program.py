"""`RobotProgram(record_work=True)`: a line for each start, and one for each end or cancellation."""

from __future__ import annotations

from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from tests.support.fake_port import FakePort, cancelled_while_working, context, outcomes, run


def recording(function: Any) -> RobotProgram:
    program = RobotProgram(record_work=True)
    program.local_task("x")(function)
    return program


@pytest.mark.parametrize(
    ("result", "outcome"),
    [(True, "success"), (None, "success"), ({"n": 1}, "success"), (False, "failure")],
)
async def test_the_result_is_recorded_and_passed_on(result: Any, outcome: str) -> None:
    async def x(task: TaskContext) -> Any:
        return result

    port = FakePort()
    assert await run(recording(x), context(port, "x")) is result
    assert outcomes(port) == [("start", None), ("end", outcome)]


async def test_without_the_option_nothing_is_recorded() -> None:
    program, port = RobotProgram(), FakePort()

    @program.local_task("x")
    async def x(task: TaskContext) -> None: ...

    await run(program, context(port, "x"))
    assert port.events == []


async def test_an_exception_is_a_failure_and_passes_through() -> None:
    async def x(task: TaskContext) -> None:
        raise ZeroDivisionError("bug")

    port = FakePort()
    with pytest.raises(ZeroDivisionError, match="bug"):
        await run(recording(x), context(port, "x"))
    assert outcomes(port) == [("start", None), ("end", "failure")]


async def test_a_cancellation_is_recorded_once_and_passes_through() -> None:
    async def x(task: TaskContext) -> None:
        await anyio.sleep_forever()

    port = FakePort()
    assert await cancelled_while_working(recording(x), context(port, "x"))
    assert outcomes(port) == [("start", None), ("cancel", None)]


async def test_what_ends_while_it_is_cancelled_ends_as_it_says() -> None:
    """It was quicker: its outcome counts."""

    async def x(task: TaskContext) -> bool:
        try:
            await anyio.sleep_forever()
        except anyio.get_cancelled_exc_class():
            return True
        return False

    port = FakePort()
    await cancelled_while_working(recording(x), context(port, "x"))
    assert outcomes(port) == [("start", None), ("end", "success")]


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
