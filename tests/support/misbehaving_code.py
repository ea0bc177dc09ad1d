"""Ways in which a local task may misbehave, and how they are noted for the test of all ways.

`told` is what the reason of the failure says of it; None: there is nothing to tell.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import threading
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any

import anyio
import numpy as np

from mrbt_mesh import TaskContext, TaskFailedError
from mrbt_mesh.btcpp import NodeStatus
from mrbt_mesh.runtime.user_code import running_call

HERE = r"\((misbehaving_code|test_user_code_misbehaviour)\.py:\d+\)"


@dataclass(frozen=True)
class Way:
    function: Callable[..., Any]
    kind: str
    told: str | None
    result: str


WAYS: dict[str, Way] = {}
STARTED: list[asyncio.Future[Any]] = []  # tasks that are only kept


def way(
    told: str | None, kind: str = "local task", result: str = "failure"
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        assert function.__name__ not in WAYS
        WAYS[function.__name__] = Way(function, kind, told, result)
        return function

    return register


def raising(name: str, error: BaseException, told: str) -> None:
    async def work(task: TaskContext) -> None:
        await anyio.sleep(1)
        raise error

    work.__name__ = name
    way(told)(work)


def returning(name: str, result: Any, told: str | None) -> None:
    async def work(task: TaskContext) -> Any:
        await anyio.sleep(1)
        return result

    work.__name__ = name
    way(told)(work)


# -- exceptions -------------------------------------------------------------------------------


class OwnBaseException(BaseException):
    pass


class SilentError(Exception):
    def __str__(self) -> str:
        raise SystemExit(1)


raising("raises_cancelled_by_hand", asyncio.CancelledError(), f"CancelledError.* {HERE}")
raising("exits", SystemExit(0), f"SystemExit: 0 {HERE}")
raising("exits_with_a_message", SystemExit("no map"), f"SystemExit: no map {HERE}")
raising("interrupts", KeyboardInterrupt(), f"KeyboardInterrupt {HERE}")
raising("generator_exit", GeneratorExit(), f"GeneratorExit {HERE}")
raising("own_base_exception", OwnBaseException("own"), f"OwnBaseException: own {HERE}")
raising("stop_iteration", StopIteration(), f"StopIteration {HERE}")
raising("stop_async_iteration", StopAsyncIteration(), f"StopAsyncIteration {HERE}")
raising("memory", MemoryError(), f"MemoryError {HERE}")
raising("disk_full", OSError(errno.ENOSPC, "No space left"), rf"OSError: \[Errno 28\].* {HERE}")
raising("broken_pipe", BrokenPipeError(), f"BrokenPipeError {HERE}")
raising("text_that_raises", SilentError(), f"SilentError.* {HERE}")
raising("huge_text", ValueError("x" * 10**6), f"ValueError: x+ {HERE}")
raising(
    "nested_groups",
    BaseExceptionGroup("a", [ExceptionGroup("b", [KeyError("grip")]), SystemExit(3)]),
    f"KeyError: 'grip' {HERE}; SystemExit: 3 {HERE}",
)
raising("reason_in_a_group", ExceptionGroup("a", [TaskFailedError("no way")]), "^no way$")


@way(f"^RecursionError: maximum recursion depth exceeded.* {HERE}")
async def recursion(task: TaskContext) -> None:
    await recursion(task)


@way(f"^RuntimeError: asyncio.run\\(\\) cannot be called .* {HERE}")
async def runs_a_loop_inside(task: TaskContext) -> None:
    asyncio.run(asyncio.sleep(0))


@way(f"^RuntimeError: Cannot close a running event loop {HERE}")
async def closes_the_loop(task: TaskContext) -> None:
    asyncio.get_running_loop().close()


@way(f"cancels tasks of the robot, which go on {HERE}: cancel only your own")
async def cancels_every_task(task: TaskContext) -> None:
    for each in asyncio.all_tasks():
        each.cancel()
    await anyio.sleep(1)


@way(f"^RuntimeError: a robot's program cannot stop the event loop .* {HERE}")
async def stops_the_loop(task: TaskContext) -> None:
    asyncio.get_running_loop().stop()


@way(f"^ValueError: 1 {HERE}; ValueError: 2 {HERE}")
async def children_of_anyio_fail(task: TaskContext) -> None:
    async def child(number: int) -> None:
        raise ValueError(number)

    async with anyio.create_task_group() as group:
        group.start_soon(child, 1)
        group.start_soon(child, 2)


@way(f"^ValueError: 1 {HERE}")
async def children_of_asyncio_fail(task: TaskContext) -> None:
    async def child() -> None:
        await asyncio.sleep(1)
        raise ValueError(1)

    async with asyncio.TaskGroup() as group:
        group.create_task(child())
        group.create_task(asyncio.sleep(100))


# -- cancellation -----------------------------------------------------------------------------


@way(f"^CancelledError: the program cancelled it, or what it waited for {HERE}")
async def awaits_a_cancelled_future(task: TaskContext) -> None:
    loop = asyncio.get_running_loop()
    future = loop.create_future()
    loop.call_later(1, future.cancel)
    await future


@way(f"^CancelledError.* {HERE}")
async def gathers_a_cancelled_future(task: TaskContext) -> None:
    future = asyncio.get_running_loop().create_future()
    future.cancel()
    await asyncio.gather(asyncio.sleep(1), future)


@way(f"^CancelledError.* {HERE}")
async def waits_for_a_task_that_was_cancelled(task: TaskContext) -> None:
    other = asyncio.ensure_future(asyncio.sleep(100))
    asyncio.get_running_loop().call_later(1, other.cancel)
    await asyncio.wait_for(other, 50)


@way(f"^CancelledError.* {HERE}")
async def cancels_itself(task: TaskContext) -> None:
    current = asyncio.current_task()
    assert current is not None
    current.cancel()
    await asyncio.sleep(1)


@way(None, result="success")
async def cancels_itself_and_returns(task: TaskContext) -> None:
    current = asyncio.current_task()
    assert current is not None
    current.cancel()


@way(None, result="success")
async def cancels_a_scope_of_its_own(task: TaskContext) -> None:
    with anyio.CancelScope() as scope:
        scope.cancel()
        await anyio.sleep(1)


@way(f"^RuntimeError: Attempted to exit a cancel scope .* {HERE}")
async def leaves_a_scope_open(task: TaskContext) -> None:
    anyio.CancelScope().__enter__()


@way("cancel scope")
async def leaves_a_group_open(task: TaskContext) -> None:
    group = anyio.create_task_group()
    await group.__aenter__()
    group.start_soon(anyio.sleep, 1)


@way("goes on after 1000 cancellations .* and was ended", "cancelled", "success")
async def swallows_every_cancellation(task: TaskContext) -> None:
    while True:
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.sleep(1)


@way("when cancelled: ValueError: stuck", "cancelled", "success")
async def fails_when_cancelled(task: TaskContext) -> None:
    try:
        await anyio.sleep_forever()
    finally:
        raise ValueError("stuck")


@way(f"still runs 5 s after it was cancelled {HERE}", "cancelled", "success")
async def shields_itself_for_long(task: TaskContext) -> None:
    with anyio.CancelScope(shield=True):
        await anyio.sleep(8)


@way("the arm has not stopped", "cancelled", "success")
async def says_what_it_waits_for(task: TaskContext) -> None:
    """As adapters do, which wait for other systems."""
    call = running_call.get()
    assert call is not None
    call.waits_for = "the arm has not stopped"
    with anyio.CancelScope(shield=True):
        await anyio.sleep(8)


@way(f"still runs 5 s after it was cancelled {HERE}", "cancelled", "timeout")
async def shields_itself_for_ever(task: TaskContext) -> None:
    with anyio.CancelScope(shield=True):
        await anyio.sleep_forever()


@way(None, "cancelled", "success")
async def returns_when_cancelled(task: TaskContext) -> bool:
    try:
        await anyio.sleep_forever()
    except BaseException:
        return True
    return True


# -- results ----------------------------------------------------------------------------------


class Unspeakable:
    def __repr__(self) -> str:
        raise RuntimeError


class BrokenMapping(dict[str, bool]):
    def items(self) -> Any:
        raise RuntimeError("broken")


WRONG = rf"returned .* {HERE}: return None or True for success"
returning("zero", 0, WRONG)
returning("failed", "failed", WRONG)
returning(
    "undeclared_name", {"ok": False}, rf"returned .*'ok': False.* {HERE}: condition 'ok' is not"
)
returning("no_truth", {"heavy": "no"}, rf"returned .* {HERE}: condition 'heavy' is set to True or")
returning("false_of_numpy", np.bool_(False), None)
returning("failure_of_a_tree", NodeStatus.FAILURE, None)
returning("running", NodeStatus.RUNNING, WRONG)
returning("huge", "x" * 10**7, WRONG)
returning("unspeakable", Unspeakable(), WRONG)
returning("class_itself", Unspeakable, WRONG)
returning("broken_mapping", BrokenMapping(a=True), "broken|returned")
returning("not_a_number", float("nan"), WRONG)


@way(WRONG)
async def returns_what_was_not_awaited(task: TaskContext) -> Any:
    async def drive() -> None: ...

    found = drive()
    asyncio.get_running_loop().call_later(5, found.close)
    return found


@way(WRONG)
async def returns_an_async_generator(task: TaskContext) -> Any:
    async def poses() -> AsyncIterator[int]:
        yield 1

    return poses()


# -- what it says -----------------------------------------------------------------------------


def saying(name: str, say: Callable[[TaskContext], Any], told: str) -> None:
    async def work(task: TaskContext) -> None:
        await anyio.sleep(1)
        say(task)

    work.__name__ = name
    way(f"{told}.* {HERE}")(work)


saying(
    "says_no", lambda t: t.set_condition("heavy", "no"), "'heavy' is set to True or False, not 'no'"
)
saying(
    "says_one", lambda t: t.set_condition("heavy", 1, at_once=True), "set to True or False, not 1"
)
saying("undeclared", lambda t: t.set_condition("light", True), "'light' is not declared")
saying("no_name", lambda t: t.set_condition(3, True), "condition 3 is not declared")
saying(
    "nan_position", lambda t: t.report_position(float("nan"), 0), "a position consists of numbers"
)
saying(
    "text_position", lambda t: t.report_position("1", 0), "a position consists of numbers, not '1'"
)
saying("half", lambda t: t.report_progress("half"), "progress is a number from 0 to 1, not 'half'")
saying("endless_progress", lambda t: t.report_progress(float("-inf")), "progress is a number")
saying("nan_progress", lambda t: t.report_progress(float("nan")), "progress is a number")
saying("nan_performance", lambda t: t.report_performance("bad", float("nan")), "a performance is")
saying("capability_7", lambda t: t.lose_capability(7), "has no local task 7")
saying(
    "capability_unknown", lambda t: t.lose_capability("nonsense"), "has no local task 'nonsense'"
)
saying("event_of_bytes", lambda t: t.record_event({"x": b"1"}), "an event has to be JSON")
saying("event_of_nan", lambda t: t.record_event({"x": float("nan")}), "an event has to be JSON")
saying("writes_the_context", lambda t: setattr(t, "robot", "R9"), "cannot assign to field 'robot'")


@way("used from another thread", result="success")
async def speaks_from_a_thread(task: TaskContext) -> None:
    errors: list[Exception] = []

    def speak() -> None:
        try:
            task.report_progress(0.5)
        except RuntimeError as error:
            errors.append(error)

    thread = threading.Thread(target=speak)
    thread.start()
    thread.join()
    STARTED.append(asyncio.ensure_future(_raise(errors[0])))


async def _raise(error: Exception) -> None:
    raise error


@way(f"a task started by: RuntimeError: 'heavy' is set after .* {HERE}", result="success")
async def speaks_when_it_is_over(task: TaskContext) -> None:
    asyncio.get_running_loop().call_later(1, task.set_condition, "heavy", True)
