"""The program waits before a step until enough was heard; a cancellation reaches it there."""

from __future__ import annotations

import asyncio
from functools import partial

import anyio
import pytest

from mrbt_mesh.runtime.step_gate import StepGate
from mrbt_mesh.runtime.user_code import UserCall

pytestmark = pytest.mark.anyio


class Desk:
    """A gate that is open or not, and a program that passes through it."""

    def __init__(self) -> None:
        self.is_open, self.is_cancelled, self.taken = True, False, 0
        self.steps: list[str] = []
        self.gate = StepGate(self._take, lambda: self.is_open)

    def _take(self) -> None:
        self.taken += 1

    def call(self, function: object) -> UserCall:
        call = UserCall("test", function, function)  # type: ignore[arg-type]
        call.gate = partial(self.gate.pass_through, lambda: self.is_cancelled)
        return call

    def open(self) -> None:
        self.is_open = True
        self.gate.look()


async def turns(count: int = 20) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


async def test_a_step_waits_for_news_and_keeps_what_was_awaited() -> None:
    desk = Desk()

    async def work() -> str:
        desk.steps.append("first")
        found = await asyncio.sleep(0, "awaited")
        desk.steps.append(found)
        return found

    desk.is_open = False
    task = asyncio.create_task(desk.call(work).run())
    await turns()
    assert desk.steps == []
    desk.gate.look()
    await turns()
    assert desk.steps == [], "nothing was heard yet"
    desk.open()
    assert await task == "awaited"
    assert desk.steps == ["first", "awaited"]
    assert desk.taken >= 2, "news is taken in before each step"


async def test_a_cancellation_reaches_the_program_before_its_next_step() -> None:
    desk = Desk()

    async def work() -> None:
        try:
            while True:
                await asyncio.sleep(0)
                desk.steps.append("step")
        finally:
            desk.steps.append("stopped")

    async with anyio.create_task_group() as group:
        call = desk.call(work)
        group.start_soon(call.run)
        await turns()
        desk.is_open = False
        await turns()
        before = len(desk.steps)
        desk.is_cancelled = True
        group.cancel_scope.cancel()
    assert desk.steps[before:] == ["stopped"], "it may end what must not be left undone"


async def test_news_that_cancels_the_action_comes_before_the_step() -> None:
    """The cancellation takes some turns of the loop, and no step is done in these."""
    desk = Desk()

    async def work() -> None:
        while True:
            await asyncio.sleep(0)
            desk.steps.append("step")

    with anyio.CancelScope() as scope:
        gate = StepGate(lambda: scope.cancel() if len(desk.steps) == 3 else None, lambda: True)
        call = desk.call(work)
        call.gate = partial(gate.pass_through, lambda: scope.cancel_called)
        await call.run()
    assert desk.steps == ["step"] * 3
