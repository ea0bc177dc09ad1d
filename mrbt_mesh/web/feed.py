"""What a page is told while the team runs: a stream that merges, so that no page lags behind."""

from __future__ import annotations

import json
import secrets
from collections.abc import AsyncIterator, Callable
from typing import Any

import anyio

from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.viewmodel.team_view import TeamView

# A page hears at least so often how late it is, and so notices a connection that is gone.
TICK_S = 1.0
# So often, at most, pages are told something.
FRAME_US = 80_000


class Feed:
    """Pages follow one observer. `clock_us` is the observer's clock."""

    def __init__(self, observer: Observer, clock_us: Callable[[], int]) -> None:
        self.observer = observer
        self.view = TeamView(observer)
        self.pages = 0
        # Versions are those of this feed; a page of an earlier one begins anew.
        self.epoch = secrets.token_hex(4)
        self._clock_us = clock_us
        self._changed = anyio.Event()
        self._is_closed = False
        self._next_us = 0

    def update(self) -> None:
        """Look at the observer, which is up to date, and tell the pages; call it often."""
        now_us = self._clock_us()
        if now_us >= self._next_us:
            self._next_us = now_us + FRAME_US
            if self.view.update(now_us):
                self.wake()

    def close(self) -> None:
        """Tell the pages that nothing more comes."""
        self.view.update(self._clock_us())
        self._is_closed = True
        self.wake()

    def wake(self) -> None:
        """Have the pages look for what has changed."""
        self._changed.set()
        self._changed = anyio.Event()

    async def messages(self, last: str) -> AsyncIterator[str]:
        """Server-sent events; `last` is the id of the last one that the page has, or empty."""
        version = self._version_of(last)
        self.pages += 1
        try:
            while True:
                changed, is_last = self._changed, self._is_closed
                news = self.view.changes.since(version)
                is_new = version == 0
                version = self.view.changes.version
                yield self._message("begin" if is_new else "news", version, news)
                if is_last:
                    yield self._message("over", version, {})
                    return
                if self._is_closed:
                    continue
                with anyio.move_on_after(TICK_S):
                    await changed.wait()
        finally:
            self.pages -= 1

    def _version_of(self, last: str) -> int:
        epoch, _, number = last.partition(".")
        known = epoch == self.epoch and number.isascii() and number.isdigit() and len(number) < 16
        return min(int(number), self.view.changes.version) if known else 0

    def _message(self, event: str, version: int, items: dict[str, Any]) -> str:
        now_s = self.observer.record.seconds(self._clock_us())
        data = json.dumps({"now_s": now_s, "items": items}, separators=(",", ":"))
        return f"id: {self.epoch}.{version}\nevent: {event}\ndata: {data}\n\n"
