"""Drivers that block, in threads: cancelled, the task has stopped when its thread has."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import Any

import anyio
import pytest

from mrbt_mesh import run_in_thread
from mrbt_mesh.runtime.robot_loop import RobotLoop
from mrbt_mesh.runtime.threads import note_threads
from mrbt_mesh.runtime.user_code import UserCall, UserCodeError


class Arm:
    """Its `weld` blocks until it is stopped, or allowed to end."""

    def __init__(self) -> None:
        self.begun, self.stopped = threading.Event(), threading.Event()
        self.is_welding = False

    def weld(self, seam: str = "a") -> str:
        self.is_welding = True
        self.begun.set()
        assert self.stopped.wait(60)
        self.is_welding = False
        return f"welded {seam}"

    def stop(self) -> None:
        self.stopped.set()


class Tried:
    """A call of a function that has begun to weld; what it reported."""

    def __init__(self, arm: Arm, work: Callable[[], Any]) -> None:
        self.said: list[str] = []
        self.arm = arm
        self.call = UserCall("weld", work, work, lambda *said: self.said.append(str(said[2])))
        self.is_over = anyio.Event()
        self.result: Any = None

    async def run(self) -> None:
        try:
            self.result = await self.call.run()
        except UserCodeError as error:
            self.result = error
        finally:
            self.is_over.set()

    async def until_begun(self) -> None:
        while not self.arm.begun.is_set():
            await anyio.sleep(0.001)


def in_robot_loop(main: Callable[[], Any]) -> Any:
    return anyio.run(main, backend_options={"loop_factory": RobotLoop})


def as_guest(main: Callable[[], Any]) -> Any:
    async def around() -> Any:
        note_threads(asyncio.get_running_loop())
        return await main()

    return asyncio.run(around())


LOOPS = pytest.mark.parametrize("in_loop", [in_robot_loop, as_guest])


@LOOPS
def test_a_driver_with_a_stop_is_stopped_when_its_task_is_cancelled(in_loop: Any) -> None:
    arm = Arm()

    async def work() -> str:
        return await run_in_thread(arm.weld, "b", stop=arm.stop)

    async def main() -> None:
        tried = Tried(arm, work)
        async with anyio.create_task_group() as group:
            group.start_soon(tried.run)
            await tried.until_begun()
            group.cancel_scope.cancel()
        assert not arm.is_welding
        assert tried.result is None

    in_loop(main)


def test_it_returns_and_raises_what_the_driver_does() -> None:
    arm = Arm()
    arm.stop()

    def breaks() -> None:
        raise OSError("no arm")

    async def main() -> None:
        assert await run_in_thread(arm.weld, "c", stop=arm.stop) == "welded c"
        with pytest.raises(OSError, match="no arm"):
            await run_in_thread(breaks, stop=arm.stop)

    in_robot_loop(main)


def test_a_driver_that_raises_because_it_was_stopped_was_cancelled() -> None:
    arm = Arm()

    def weld() -> None:
        arm.weld()
        raise OSError("stopped")

    async def main() -> None:
        async with anyio.create_task_group() as group:
            group.start_soon(lambda: run_in_thread(weld, stop=arm.stop))
            while not arm.begun.is_set():
                await anyio.sleep(0.001)
            group.cancel_scope.cancel()

    in_robot_loop(main)
    assert not arm.is_welding


@LOOPS
@pytest.mark.parametrize("way", ["to_thread", "executor", "unawaited"])
def test_a_task_has_stopped_when_the_threads_that_it_began_have(in_loop: Any, way: str) -> None:
    arm = Arm()

    async def work() -> None:
        if way == "to_thread":
            await asyncio.to_thread(arm.weld)
        elif way == "executor":
            await asyncio.get_running_loop().run_in_executor(None, arm.weld)
        else:
            asyncio.get_running_loop().run_in_executor(None, arm.weld)
            await anyio.sleep_forever()

    async def main() -> None:
        tried = Tried(arm, work)
        async with anyio.create_task_group() as group:
            group.start_soon(tried.run)
            await tried.until_begun()
            group.cancel_scope.cancel()
            with anyio.CancelScope(shield=True):
                await anyio.sleep(0.05)
                assert not tried.is_over.is_set()
                assert tried.call.place().startswith("test_threads.py:")
                arm.stop()
                await tried.is_over.wait()
        assert not arm.is_welding

    in_loop(main)


def test_a_robot_that_ends_waits_for_no_thread() -> None:
    arm = Arm()

    async def main() -> None:
        tried = Tried(arm, lambda: asyncio.to_thread(arm.weld))
        async with anyio.create_task_group() as group:
            group.start_soon(tried.run)
            await tried.until_begun()
            group.cancel_scope.cancel()
            asyncio.get_running_loop().call_later(0.05, tried.call.abandon)
        assert arm.is_welding
        arm.stop()

    in_robot_loop(main)


def test_one_that_goes_on_after_the_task_is_named() -> None:
    arm = Arm()

    async def work() -> None:
        asyncio.get_running_loop().run_in_executor(None, arm.weld)

    async def main() -> None:
        tried = Tried(arm, work)
        await tried.run()
        assert tried.result is None
        (said,) = tried.said
        assert said.startswith("a thread goes on after it (test_threads.py:")
        arm.stop()

    in_robot_loop(main)


def test_a_library_may_leave_its_threads() -> None:
    """As asyncio does, which looks up names in them."""

    async def work() -> None:
        with anyio.move_on_after(0.01):
            await asyncio.get_running_loop().getaddrinfo("localhost", 80)

    async def main() -> None:
        call = UserCall("look", work, work)
        await call.run()

    in_robot_loop(main)
