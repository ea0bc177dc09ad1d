"""The stream of changes for pages; changes are merged, so that no page lags behind."""

from __future__ import annotations

import json
import secrets
from collections.abc import AsyncGenerator, Callable
from typing import Any

import anyio

from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.team_view import Shown
from mrbt_mesh.views.web.connections import gives_way

# Longest time between messages, by which a page notices a lost connection.
TICK_S = 1.0
# Pages that follow at once; each gets every change.
MAX_PAGES = 64
# Shortest time between messages.
FRAME_US = 80_000


class _Page:
    """One that follows; each is equal to itself alone."""

    is_served = True

    def __init__(self, address: str) -> None:
        self.address = address


class Feed:
    """Pages follow one view. `clock_us` is the clock of its observer."""

    def __init__(self, view: Shown, clock_us: Callable[[], int]) -> None:
        self.view = view
        # The oldest first.
        self._pages: list[_Page] = []
        # Versions are those of this feed; a page of an earlier one begins anew.
        self.epoch = secrets.token_hex(4)
        self._clock_us = clock_us
        self._changed = anyio.Event()
        self._is_closed = False
        # Whether the run had ended when the view was last looked at.
        self._is_run_over = False
        self._next_us = 0

    @property
    def observer(self) -> Observer:
        """The team as it is shown now."""
        return self.view.observer

    @property
    def now_us(self) -> int:
        """The time on the clock of the observer; in a recording, where that is."""
        return self._clock_us()

    @property
    def pages(self) -> int:
        """How many follow."""
        return len(self._pages)

    def update(self) -> None:
        """Look at the observer, which is up to date, and send changes; call it often."""
        now_us = self._clock_us()
        if now_us >= self._next_us:
            self._next_us = now_us + FRAME_US
            self.show()

    def show(self) -> None:
        """Look at the observer at once, and send changes."""
        has_changed = self.view.update(self._clock_us())
        self._is_run_over = self.observer.is_over
        if has_changed:
            self.wake()

    def close(self) -> None:
        """Send the last changes, and end the stream."""
        self.view.update(self._clock_us())
        self._is_closed = True
        self.wake()

    def wake(self) -> None:
        """Have the pages look for what has changed."""
        self._changed.set()
        self._changed = anyio.Event()

    def messages(
        self,
        last: str,
        address: str = "",
        limit: int | None = None,
        ends_with_run: bool = False,
    ) -> AsyncGenerator[str, None]:
        """Server-sent events; `last` is the id of the last one that the page has, or empty.

        With a `limit` it ends after so many, and the first one waits for news. `ends_with_run`: it
        is over once the run is, and not only when it is closed. It counts as a page from now on.
        Beyond `MAX_PAGES` an older one ends, of the `address` that has the most; a browser then
        asks again.
        """
        page = _Page(address)
        if len(self._pages) >= MAX_PAGES:
            self._pages.remove(gives_way(self._pages))
            self.wake()
        self._pages.append(page)
        return self._messages(self._version_of(last), page, limit, ends_with_run)

    async def _messages(
        self, version: int, page: _Page, limit: int | None, ends_with_run: bool
    ) -> AsyncGenerator[str, None]:
        count = 0

        def is_over() -> bool:
            return self._is_closed or (ends_with_run and self._is_run_over)

        try:
            if limit is not None and version == self.view.changes.version:
                if not is_over():
                    with anyio.move_on_after(TICK_S):
                        await self._changed.wait()
                elif version:  # it has everything
                    yield self._message("over", version, {})
                    return
            while page in self._pages:
                changed, is_last = self._changed, is_over()
                version = self.view.changes.start_of(version)
                news = self.view.changes.since(version)
                is_new = version == 0
                version = self.view.changes.version
                yield self._message("begin" if is_new else "news", version, news)
                count += 1
                if count == limit:
                    return
                if is_last:
                    yield self._message("over", version, {})
                    return
                if self._is_closed:
                    continue
                with anyio.move_on_after(TICK_S):
                    await changed.wait()
        finally:
            if page in self._pages:
                self._pages.remove(page)

    def _version_of(self, last: str) -> int:
        epoch, _, number = last.partition(".")
        known = epoch == self.epoch and number.isascii() and number.isdigit() and len(number) < 16
        return min(int(number), self.view.changes.version) if known else 0

    def _message(self, event: str, version: int, items: dict[str, Any]) -> str:
        now_s = self.view.seconds(self._clock_us())
        data = {"now_s": now_s, "run": self.observer.facts.run, "items": items}
        text = json.dumps(data, separators=(",", ":"))
        return f"id: {self.epoch}.{version}\nevent: {event}\ndata: {text}\n\n"
