"""Requests are answered in their order, and do not wait in turn for one that takes long."""

from __future__ import annotations

from collections.abc import AsyncIterator

import anyio
import pytest

from mrbt_mesh.adapters.rmf import in_order
from mrbt_mesh.adapters.rmf.in_order import RequestsInOrder


class Work:
    """Requests are numbers; the even ones wait until they are allowed to end."""

    def __init__(self) -> None:
        self.begun: list[int] = []
        self.may_end = anyio.Event()

    async def carry_out(self, number: int) -> int:
        self.begun.append(number)
        if number % 2 == 0:
            await self.may_end.wait()
        return number


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(in_order, "PATIENCE_S", 0.001)


async def taken(answers: AsyncIterator[int], count: int) -> list[int]:
    return [await anext(answers) for _ in range(count)]


async def test_others_begin_behind_one_that_waits_and_answers_keep_the_order() -> None:
    work = Work()
    async with anyio.create_task_group() as group:
        requests = RequestsInOrder(group, work.carry_out)
        for number in range(6):
            await requests.take(number)
        assert work.begun == list(range(6)), "none waited for the first one to end"
        work.may_end.set()
        assert await taken(requests.answers(), 6) == list(range(6))


async def test_a_request_begins_once_the_one_before_it_is_done(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(in_order, "PATIENCE_S", 60.0)
    order: list[str] = []

    async def carry_out(name: str) -> str:
        order.append(f"{name} begins")
        await anyio.lowlevel.checkpoint()
        order.append(f"{name} ends")
        return name

    async with anyio.create_task_group() as group:
        requests = RequestsInOrder(group, carry_out)
        for name in "ab":
            await requests.take(name)
    assert order == ["a begins", "a ends", "b begins", "b ends"]


async def test_not_more_than_so_many_wait_for_their_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(in_order, "MOST_AT_ONCE", 3)
    work = Work()
    async with anyio.create_task_group() as group:
        requests = RequestsInOrder(group, work.carry_out)
        for number in range(3):
            await requests.take(number)
        with anyio.move_on_after(0.01) as waited:
            await requests.take(3)
        assert waited.cancelled_caught
        work.may_end.set()
        assert await taken(requests.answers(), 3) == [0, 1, 2]
