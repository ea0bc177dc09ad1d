"""Calls of a program's functions, whatever these do."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import anyio
import pytest

from mrbt_mesh import TaskFailedError
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON
from mrbt_mesh.runtime.user_code import UserCall, UserCodeError, shown

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


async def test_a_plain_function_and_any_awaitable() -> None:
    future = asyncio.get_running_loop().create_future()
    future.set_result(4)
    assert await UserCall("bid", lambda: 3, lambda: 3).run() == 3
    assert await UserCall("bid", lambda: future, lambda: future).run() == 4


async def test_groups_are_opened() -> None:
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
