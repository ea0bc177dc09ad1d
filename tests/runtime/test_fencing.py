"""A robot in another program's event loop notices when that was stopped, before anything else."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.fencing import fenced

LIMIT_US = 50_000


def stand_still(seconds: float) -> None:
    """As a process that is stopped: nothing of it runs."""
    threading.Event().wait(seconds)


def selector() -> Any:
    return asyncio.get_running_loop()._selector  # type: ignore[attr-defined]


async def test_a_gap_is_told_before_timers_that_came_due_in_it() -> None:
    said: list[str] = []
    loop = asyncio.get_running_loop()
    with fenced(loop, LIMIT_US, lambda: said.append("gap")):
        due = loop.create_future()
        loop.call_later(0.01, lambda: (said.append("timer"), due.set_result(None)))
        stand_still(0.1)
        await due
    assert said == ["gap", "timer"]


async def test_without_a_gap_nothing_is_told() -> None:
    said: list[str] = []
    with fenced(asyncio.get_running_loop(), 60_000_000, lambda: said.append("gap")):
        await asyncio.sleep(0.01)
    assert said == []


@pytest.mark.parametrize("first_out", [0, 1, 2])
async def test_several_in_one_loop_end_in_any_order(first_out: int) -> None:
    before = selector()
    said: list[int] = []
    loop = asyncio.get_running_loop()
    members = [fenced(loop, LIMIT_US, lambda n=n: said.append(n)) for n in range(3)]
    for each in members:
        each.__enter__()
    members.pop(first_out).__exit__(None, None, None)
    stand_still(0.1)
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert sorted(set(said)) == [number for number in range(3) if number != first_out]
    for each in members:
        each.__exit__(None, None, None)
    assert selector() is before


def test_a_loop_without_a_selector_is_refused() -> None:
    class Strange(asyncio.BaseEventLoop): ...

    loop = Strange()
    with pytest.raises(InputError, match=r"cannot fence itself off in .*Strange"):
        fenced(loop, LIMIT_US, lambda: None).__enter__()
    loop.close()
