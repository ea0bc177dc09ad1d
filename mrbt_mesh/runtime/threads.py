"""Threads in which a robot's program runs blocking drivers."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import anyio

from mrbt_mesh.driven import is_library
from mrbt_mesh.runtime.user_code import (
    ThreadWork,
    UserCall,
    frames_of,
    is_ours,
    place_of,
    running_call,
)

_T = TypeVar("_T")
_ASYNCIO = Path(asyncio.__file__).parent


async def run_in_thread(
    function: Callable[..., _T], *arguments: Any, stop: Callable[[], object]
) -> _T:
    """Call a blocking function in a thread, and `stop` it when the local task is cancelled.

        await run_in_thread(arm.weld, seam, stop=arm.stop)

    `stop` is called, also in a thread, to make `function` return soon. The task has stopped only
    then, and the robot starts nothing else before. Without `stop`, a blocking driver would continue
    after another robot has taken over. Returns and raises what `function` does.
    """
    work = asyncio.ensure_future(anyio.to_thread.run_sync(partial(function, *arguments)))
    try:
        return await asyncio.shield(work)
    except anyio.get_cancelled_exc_class():
        with anyio.CancelScope(shield=True):
            if not work.done():
                await anyio.to_thread.run_sync(stop)
            await asyncio.wait([work])
        if not work.cancelled():
            work.exception()  # retrieved, so that asyncio does not report what it raised on `stop`
        raise


class _NotingExecutor:
    """Submits to an executor, and registers the work with the program's call."""

    def __init__(self, executor: Any, call: UserCall, place: str) -> None:
        self._executor = executor
        self._call = call
        self._place = place

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = self._executor.submit(function, *arguments)
        loop, work, threads = (
            asyncio.get_running_loop(),
            ThreadWork(self._place),
            self._call.threads,
        )
        threads.add(work)

        def over() -> None:
            threads.discard(work)
            work.over.set()

        def tell(_: object) -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(over)

        future.add_done_callback(tell)
        return future


_threads = ThreadPoolExecutor(thread_name_prefix="program")


def in_noted_thread(
    run: Callable[..., Any], executor: Any, function: Callable[..., Any], *arguments: Any
) -> Any:
    """Implement `run_in_executor` of an event loop.

    Work that the program itself starts, as with `asyncio.to_thread`, is registered with its call.
    Work of libraries, such as looking up names, is not.
    """
    call = running_call.get()
    frames = [(Path(file), line) for file, line in frames_of(sys._getframe(1))]
    users = [(f, line) for f, line in frames if not f.is_relative_to(_ASYNCIO) and not is_ours(f)]
    if call is None or (users and is_library(users[-1][0])):
        return run(executor, function, *arguments)
    place = place_of(call.function, [(str(file), line) for file, line in users])
    return run(_NotingExecutor(executor or _threads, call, place), function, *arguments)


def note_threads(loop: asyncio.AbstractEventLoop) -> None:
    """Apply `in_noted_thread` to another program's event loop, in which robots are guests."""
    if "run_in_executor" not in vars(loop):
        noting: Any = partial(in_noted_thread, loop.run_in_executor)
        vars(loop)["run_in_executor"] = noting
