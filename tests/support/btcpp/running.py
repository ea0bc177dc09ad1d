"""Trees run to their end on a virtual clock."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeVar

from mrbt_mesh.sim.world.clock import VirtualClock, VirtualLoop

T = TypeVar("T")


def in_virtual_time(program: Callable[[], Awaitable[T]]) -> tuple[T, float]:
    """What a program returns, and how many seconds it took by its own clock."""
    clock = VirtualClock()
    loop = VirtualLoop(clock)
    try:
        result = loop.run_until_complete(_awaited(program))
    finally:
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.close()
    return result, clock.now_us / 1e6


async def _awaited(program: Callable[[], Awaitable[T]]) -> T:
    return await program()
