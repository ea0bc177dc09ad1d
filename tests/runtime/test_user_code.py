"""Calls of a program's functions, whatever these do."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import anyio
import pytest

from mrbt_mesh import TaskFailedError
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON
from mrbt_mesh.runtime.user_code import MAX_SWALLOWED, UserCall, UserCodeError, shown

HERE = "test_user_code.py"


async def reason_of(function: Callable[..., Any]) -> str:
    """The failure of a function, which must not touch who calls it."""
    with pytest.raises(UserCodeError) as failure:
        await UserCall("work", function, function).run()
    task = asyncio.current_task()
    assert task is not None
    assert not task.cancelling()
    await anyio.lowlevel.checkpoint()
    assert len(failure.value.reason) <= MAX_REASON
    return failure.value.reason


def line(function: Callable[..., Any], offset: int) -> str:
    return f"({HERE}:{function.__code__.co_firstlineno + offset})"


async def cancelled_future() -> None:
    future = asyncio.get_running_loop().create_future()
    asyncio.get_running_loop().call_soon(future.cancel)
    await future


async def cancels_itself() -> None:
    current = asyncio.current_task()
    assert current is not None
    current.cancel()
    await asyncio.sleep(0)


async def cancels_itself_and_returns() -> str:
    current = asyncio.current_task()
    assert current is not None
    current.cancel()
    return "done"


async def leaves_a_scope_open() -> str:
    anyio.CancelScope().__enter__()
    return "done"


async def exits() -> None:
    raise SystemExit(3)


async def interrupts() -> None:
    raise KeyboardInterrupt


async def closes() -> None:
    raise GeneratorExit


@pytest.mark.parametrize(
    ("function", "named", "offset"),
    [
        (cancelled_future, "CancelledError: the program cancelled it", 3),
        (cancels_itself, "CancelledError", 4),
        (exits, "SystemExit: 3", 1),
        (interrupts, "KeyboardInterrupt", 1),
        (closes, "GeneratorExit", 1),
    ],
)
async def test_what_is_no_exception_of_a_program_is_its_failure(
    function: Callable[..., Any], named: str, offset: int
) -> None:
    reason = await reason_of(function)
    assert reason.startswith(named)
    assert reason.endswith(line(function, offset))


async def test_what_a_function_leaves_behind_ends_with_it() -> None:
    with anyio.CancelScope() as scope:
        call = UserCall("work", cancels_itself_and_returns, cancels_itself_and_returns)
        assert await call.run() == "done"
        assert "cancel scope" in await reason_of(leaves_a_scope_open)
    assert not scope.cancelled_caught


async def test_a_plain_function_and_any_awaitable() -> None:
    future = asyncio.get_running_loop().create_future()
    future.set_result(4)
    assert await UserCall("bid", lambda: 3, lambda: 3).run() == 3
    assert await UserCall("bid", lambda: future, lambda: future).run() == 4


async def test_groups_are_opened() -> None:
    async def worker(number: int) -> None:
        await anyio.lowlevel.checkpoint()
        raise ValueError(f"number {number}")

    async def work() -> None:
        async with anyio.create_task_group() as group:
            group.start_soon(worker, 1)
            group.start_soon(worker, 2)

    where = line(worker, 2)
    assert await reason_of(work) == f"ValueError: number 1 {where}; ValueError: number 2 {where}"

    def nested() -> None:
        inner = ExceptionGroup("inner", [KeyError(n) for n in range(4)])
        raise BaseExceptionGroup(
            "outer", [BaseExceptionGroup("x", [asyncio.CancelledError()]), inner]
        )

    assert (await reason_of(nested)).endswith("; 1 more")
    assert (await reason_of(nested)).startswith("KeyError: 0 (")


async def test_a_reason_that_was_given_is_kept_in_a_group() -> None:
    async def worker() -> None:
        raise TaskFailedError("no way")

    async def work() -> None:
        async with anyio.create_task_group() as group:
            group.start_soon(worker)

    assert await reason_of(work) == "no way"


class UnspeakableError(Exception):
    def __str__(self) -> str:
        raise RuntimeError("not this either")


class UnspeakableFailureError(TaskFailedError):
    def __str__(self) -> str:
        raise RuntimeError("not this either")


@pytest.mark.parametrize(
    "error", [UnspeakableError(), UnspeakableFailureError(), ValueError("x\ny" * 999)]
)
async def test_exceptions_that_are_hard_to_tell(error: Exception) -> None:
    def work() -> None:
        raise error

    assert type(error).__name__ in await reason_of(work)


async def cancelled(function: Callable[..., Any]) -> str:
    """What a function says in place of its cancellation."""
    call = UserCall("work", function, function)
    async with anyio.create_task_group() as group:
        group.start_soon(call.run)
        for _ in range(3):
            await anyio.lowlevel.checkpoint()
        group.cancel_scope.cancel()
    assert group.cancel_scope.cancelled_caught
    assert call.late_failure is not None
    return call.late_failure.reason


# Python says so of what ignores that it is closed.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("swallowed", [asyncio.CancelledError, BaseException])
async def test_one_that_swallows_every_cancellation_is_ended(
    swallowed: type[BaseException],
) -> None:
    count = 0

    async def work() -> None:
        nonlocal count
        while True:
            try:
                await anyio.sleep_forever()
            except swallowed:
                count += 1

    assert "was ended: raise the cancellation again" in await cancelled(work)
    assert count >= MAX_SWALLOWED


async def test_what_fails_while_it_is_cancelled_is_told() -> None:
    async def work() -> None:
        try:
            await anyio.sleep_forever()
        finally:
            raise ValueError("the gripper is stuck")

    assert (await cancelled(work)).startswith("ValueError: the gripper is stuck")


async def test_one_that_ends_before_the_cancellation_reaches_it_has_ended() -> None:
    scope = anyio.CancelScope()

    async def work() -> int:
        scope.cancel()
        return 5

    with scope:
        found = await UserCall("work", work, work).run()
    assert found == 5


async def test_where_it_waits() -> None:
    async def waits() -> None:
        await anyio.sleep_forever()

    async def work() -> None:
        await waits()

    call = UserCall("work", work, work)
    async with anyio.create_task_group() as group:
        group.start_soon(call.run)
        for _ in range(3):
            await anyio.lowlevel.checkpoint()
        assert f"({call.place()})" == line(waits, 1)
        group.cancel_scope.cancel()


class Strange:
    def __repr__(self) -> str:
        raise RuntimeError


@pytest.mark.parametrize("value", ["x" * 10**7, list(range(10**6)), Strange(), {1: Strange()}])
def test_values_in_messages_are_short(value: Any) -> None:
    assert len(shown(value)) <= 60
