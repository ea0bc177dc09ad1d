"""An event loop that a program does not end, and what names code that blocks it."""

from __future__ import annotations

import asyncio
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

import anyio
import pytest

from mrbt_mesh.runtime.robot_loop import LoopWatchdog, RobotLoop, blocking_place
from mrbt_mesh.runtime.user_code import UserCall, frames_of


def in_robot_loop(main: Callable[[], Any]) -> Any:
    return anyio.run(main, backend_options={"loop_factory": RobotLoop})


def test_ctrl_c_ends_it_as_any_other() -> None:
    async def main() -> None:
        signal.raise_signal(signal.SIGINT)
        await anyio.sleep_forever()

    # Tests that run in the background of a shell ignore the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            in_robot_loop(main)
    finally:
        signal.signal(signal.SIGINT, before)


def test_the_watchdog_names_a_step_that_does_not_end_once() -> None:
    told: list[list[tuple[str, int]]] = []
    named = threading.Event()

    def tell(frames: list[tuple[str, int]]) -> None:
        told.append(frames)
        named.set()

    with LoopWatchdog(0.02, lambda: 7, tell):
        assert named.wait(30)
        time.sleep(0.05)  # it looks again
    assert len(told) == 1
    names = [file.rpartition("/")[2] for file, _ in told[0]]
    assert "test_robot_loop.py" in names


def test_the_watchdog_leaves_alone_what_goes_on_or_waits() -> None:
    asked = iter(range(10**9))
    looked = threading.Event()

    def goes_on() -> int | None:
        number = next(asked)
        if number > 30:
            looked.set()
        return number if number % 3 else None

    with LoopWatchdog(0.005, goes_on, lambda _: pytest.fail("it goes on")):
        assert looked.wait(30)


def test_what_blocks_is_a_call_or_code_of_the_program_or_nothing_of_it() -> None:
    def work() -> list[tuple[str, int]]:
        import sys

        return frames_of(sys._getframe())

    here = work()
    call = UserCall("bid for carry(1)", work, work)
    assert (blocking_place(call, here) or "").startswith("bid for carry(1) at test_robot_loop.py:")
    assert (blocking_place(None, here) or "").startswith("test_robot_loop.py:")
    assert blocking_place(None, [(asyncio.__file__, 1), (anyio.__file__, 2)]) is None
