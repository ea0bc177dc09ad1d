"""A selector that notices when this process was stopped, before anything else runs.

After SIGSTOP and SIGCONT, or a suspend, asyncio would first run every timer that came due
meanwhile: an action's last step would be carried out although another robot has long taken
over. So the clock is read right after every wait, and `on_gap` cancels actions first.
"""

from __future__ import annotations

import selectors
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

_CLOCK = time.CLOCK_BOOTTIME if sys.platform == "linux" else time.CLOCK_MONOTONIC


def boottime_us() -> int:
    """Microseconds on a clock that also runs while the system is suspended, where there is one."""
    return time.clock_gettime_ns(_CLOCK) // 1_000


class FencingSelector(selectors.BaseSelector):
    """The default selector, plus a look at the clock after each wait.

    `on_gap()` is called if more than `limit_us` have passed since the wait before. An agent
    wakes for every beat, so that only happens if the process did not run.
    """

    def __init__(self, limit_us: int) -> None:
        self._inner = selectors.DefaultSelector()
        self._limit_us = limit_us
        self._seen_us = boottime_us()
        self.on_gap: Callable[[], None] = lambda: None

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = self._inner.select(timeout)
        now_us = boottime_us()
        gap_us, self._seen_us = now_us - self._seen_us, now_us
        if gap_us > self._limit_us:
            self.on_gap()
        return ready

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._inner.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._inner.modify(fileobj, events, data)

    def close(self) -> None:
        self._inner.close()

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._inner.get_map()
