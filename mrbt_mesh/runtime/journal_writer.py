"""When a robot's facts go to its journal: at once, or together with others a little later."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from typing import Protocol

from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.runtime.journal import LAZY_COMMIT_S, Journal

RETRY_COMMIT_S = 1.0


class Durations(Protocol):
    """Is told how long each of something took."""

    def observe(self, seconds: float) -> None: ...


class JournalWriter:
    """Writes to a journal from an event loop; without a journal it does nothing.

    `synced_s` is told how long each synced write took.
    """

    def __init__(self, journal: Journal | None, synced_s: Durations | None = None) -> None:
        self._journal = journal
        self._synced_s = synced_s
        self._timer: asyncio.TimerHandle | None = None

    def put(self, entries: Iterable[Entry], synced: bool) -> None:
        """Keep entries; `synced`: they are on disk when this returns."""
        if self._journal is not None:
            self._journal.put(entries)
            if synced:
                began_s = time.perf_counter()
                self._journal.commit()
                if self._synced_s is not None:
                    self._synced_s.observe(time.perf_counter() - began_s)
            else:
                self._commit_after(LAZY_COMMIT_S)

    def forget(self, keys: Iterable[tuple[str, str]]) -> None:
        """Drop entries, by author and name."""
        if self._journal is not None:
            self._journal.forget(keys)
            self._commit_after(LAZY_COMMIT_S)

    def close(self) -> None:
        """Write what is left, and close the journal."""
        if self._timer is not None:
            self._timer.cancel()
        if self._journal is not None:
            self._journal.close()

    def _commit_after(self, wait_s: float) -> None:
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(wait_s, self._commit)

    def _commit(self) -> None:
        self._timer = None
        if self._journal is not None and not self._journal.commit():
            self._commit_after(RETRY_COMMIT_S)
