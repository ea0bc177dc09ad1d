"""A selector that notices that the process was suspended, before anything else runs.

After SIGSTOP and SIGCONT, or a suspend, asyncio would first run every timer that came due
meanwhile: an action's last step would be carried out although another robot has long taken over. So
the clock is read right after every wait, and `on_gap` cancels actions first.

A robot inside another program shares that program's event loop: `fenced` adds the check of the
clock to it for as long as the robot is there.
"""

from __future__ import annotations

import asyncio
import selectors
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from mrbt_mesh.errors import InputError

_CLOCK = time.CLOCK_BOOTTIME if sys.platform == "linux" else time.CLOCK_MONOTONIC


def boottime_us() -> int:
    """Return microseconds of a clock that, where possible, also runs during a suspend."""
    return time.clock_gettime_ns(_CLOCK) // 1_000


class FencingSelector(selectors.BaseSelector):
    """The default selector, plus a check of the clock after each wait.

    `on_gap()` is called if more than `limit_us` have passed since the previous wait. An agent wakes
    for every beat, so that happens only if the process did not run.
    """

    def __init__(self, limit_us: int, inner: selectors.BaseSelector | None = None) -> None:
        self.inner = inner or selectors.DefaultSelector()
        self._limit_us = limit_us
        self._seen_us = boottime_us()
        self.on_gap: Callable[[], None] = lambda: None
        self._turns = 0
        self._waits = False

    def step(self) -> int | None:
        """Return the number of the loop's turn, None while it waits.

        May be called from another thread.
        """
        return None if self._waits else self._turns

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self._waits = True
        ready = self.inner.select(timeout)
        self._turns += 1
        self._waits = False
        now_us = boottime_us()
        gap_us, self._seen_us = now_us - self._seen_us, now_us
        if gap_us > self._limit_us:
            self.on_gap()
        return ready

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self.inner.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self.inner.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self.inner.modify(fileobj, events, data)

    def close(self) -> None:
        self.inner.close()

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self.inner.get_map()


def selector_of(loop: asyncio.AbstractEventLoop) -> selectors.BaseSelector:
    """Return the selector of a loop. Raises InputError for a loop without one."""
    # asyncio has no public API for this; the attribute is as old as asyncio's loops.
    found: selectors.BaseSelector | None = getattr(loop, "_selector", None)
    if not isinstance(loop, asyncio.SelectorEventLoop) or found is None:
        raise InputError(
            f"a robot cannot fence itself off in {type(loop).__module__}.{type(loop).__name__}: "
            "run the program in asyncio's SelectorEventLoop, its default on Linux and macOS"
        )
    return found


@contextmanager
def fenced(
    loop: asyncio.AbstractEventLoop, limit_us: int, on_gap: Callable[[], None]
) -> Iterator[FencingSelector]:
    """Call `on_gap` in a running loop like `FencingSelector` does; several may be nested.

    Raises InputError for a loop without a selector, where a gap would not be noticed in time.
    """
    mine = FencingSelector(limit_us, selector_of(loop))
    mine.on_gap = on_gap
    loop._selector = mine  # type: ignore[attr-defined]
    try:
        yield mine
    finally:
        _take_out(loop, mine)


def _take_out(loop: asyncio.AbstractEventLoop, mine: FencingSelector) -> None:
    """Remove a selector from the chain; those added after it stay."""
    above, each = None, loop._selector  # type: ignore[attr-defined]
    while each is not mine:
        above, each = each, each.inner
    if above is None:
        loop._selector = mine.inner  # type: ignore[attr-defined]
    else:
        above.inner = mine.inner
