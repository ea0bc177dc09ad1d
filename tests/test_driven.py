"""What a coroutine that can be given up waits for, and what it hears of that."""

from __future__ import annotations

import asyncio

import anyio
import pytest

from mrbt_mesh.driven import Driven


def refuse() -> None:
    raise ConnectionRefusedError("nobody listens")


async def test_a_coroutine_may_catch_what_it_waited_for_and_go_on() -> None:
    """A connection that is refused in a thread, as that of a broker which is away."""

    async def connect() -> str:
        try:
            await asyncio.get_running_loop().run_in_executor(None, refuse)
        except OSError as error:
            await anyio.lowlevel.checkpoint()
            return str(error)
        return "connected"

    assert await Driven(connect(), "token") == "nobody listens"


async def test_what_a_coroutine_does_not_catch_is_raised_and_its_clauses_are_run() -> None:
    ended: list[str] = []

    async def connect() -> None:
        try:
            await asyncio.get_running_loop().run_in_executor(None, refuse)
        finally:
            await anyio.lowlevel.checkpoint()
            ended.append("in order")

    with pytest.raises(ConnectionRefusedError):
        await Driven(connect(), "token")
    assert ended == ["in order"]
