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

# The longest time between messages, by which a page notices a lost connection.
TICK_S = 1.0
# The maximum number of simultaneous pages; each gets every change.
MAX_PAGES = 64
# Shortest time between messages.
FRAME_US = 80_000


class _Page:
    """A page that follows a feed; compared by identity."""

    is_served = True

    def __init__(self, address: str) -> None:
        self.address = address


class Feed:
    """Serves one view to pages. `clock_us` is the clock of its observer."""

    def __init__(self, view: Shown, clock_us: Callable[[], int]) -> None:
        self.view = view
        # The oldest first.
        self._pages: list[_Page] = []
        # Versions belong to this feed; a page of an earlier feed starts anew.
        self.epoch = secrets.token_hex(4)
        self._clock_us = clock_us
        self._changed = anyio.Event()
        self._is_closed = False
        # Whether the run had ended when the view was last looked at.
        self._is_run_over = False
        self._next_us = 0

    @property
    def observer(self) -> Observer:
        """The team as currently shown."""
        return self.view.observer

    @property
    def now_us(self) -> int:
        """The time on the clock of the observer; in a recording, the current position."""
        return self._clock_us()

    @property
    def pages(self) -> int:
        """How many pages follow."""
        return len(self._pages)

    def update(self) -> None:
        """Update from the observer, which must be up to date, and send changes; call it often."""
        now_us = self._clock_us()
        if now_us >= self._next_us:
            self._next_us = now_us + FRAME_US
            self.show()

    def show(self) -> None:
        """Update from the observer at once, and send changes."""
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
        """Make the pages check for changes."""
        self._changed.set()
        self._changed = anyio.Event()

    def messages(
        self,
        last: str,
        address: str = "",
        limit: int | None = None,
        ends_with_run: bool = False,
    ) -> AsyncGenerator[str, None]:
        """Return server-sent events; `last` is the id of the page's last event, or empty.

        With a `limit`, the stream ends after that many events, and the first one waits for news.
        `ends_with_run`: it ends with the run, not only when the feed is closed. It counts as a page
        from now on. Beyond `MAX_PAGES`, an older page of the `address` with the most pages ends;
        its browser then reconnects.
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
