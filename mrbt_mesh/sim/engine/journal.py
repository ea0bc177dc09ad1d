"""A journal in the simulator: what the disk keeps of it when a process dies at any moment.

Works as `runtime.journal`: entries are put, and written with the next commit; a commit is
synced, so it survives whatever comes. What was only put is lost with the process.
"""

from __future__ import annotations

from collections.abc import Iterable

from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.runtime.journal import LAZY_COMMIT_S
from mrbt_mesh.sim.engine.clock import MICRO, VirtualClock
from mrbt_mesh.sim.engine.pace import Pace

LAZY_COMMIT_US = round(LAZY_COMMIT_S * MICRO)


class SimJournal:
    """The journal of one robot; it outlives the robot's processes."""

    def __init__(self) -> None:
        self._written: dict[tuple[str, str], Entry] = {}
        self._pending: dict[tuple[str, str], Entry | None] = {}

    @property
    def is_clean(self) -> bool:
        """Whether everything that was put has been written."""
        return not self._pending

    def put(self, entries: Iterable[Entry]) -> None:
        """Take entries in; they are on disk after the next `commit`."""
        for entry in entries:
            self._pending[entry.author, entry.name] = entry

    def forget(self, keys: Iterable[tuple[str, str]]) -> None:
        """Drop entries; they are gone from disk after the next `commit`."""
        for key in keys:
            self._pending[key] = None

    def commit(self) -> None:
        """Write and sync everything that was put or forgotten."""
        for key, entry in self._pending.items():
            if entry is None:
                self._written.pop(key, None)
            else:
                self._written[key] = entry
        self._pending.clear()

    def crash(self) -> None:
        """The process is gone, and with it what was not written."""
        self._pending.clear()

    def read(self) -> tuple[Entry, ...]:
        """What a new process finds."""
        return tuple(self._written[key] for key in sorted(self._written))

    def written(self, author: str, name: str) -> Entry | None:
        """One entry as it stands on disk."""
        return self._written.get((author, name))


class SimJournalWriter:
    """What one process writes to its robot's journal: at once, or a little later together."""

    def __init__(self, journal: SimJournal, clock: VirtualClock, pace: Pace) -> None:
        self._journal = journal
        self._clock = clock
        self._pace = pace
        self._is_due = False

    def put(self, entries: Iterable[Entry], synced: bool) -> None:
        """Write entries; `synced`: now."""
        self._journal.put(entries)
        if synced:
            self._journal.commit()
        else:
            self._commit_soon()

    def forget(self, keys: Iterable[tuple[str, str]]) -> None:
        """Drop entries, a little later."""
        self._journal.forget(keys)
        self._commit_soon()

    def commit(self) -> None:
        """Write all that waits."""
        self._journal.commit()

    def crash(self) -> None:
        """The process is gone, and with it what was not written."""
        self._journal.crash()

    def _commit_soon(self) -> None:
        if not self._is_due:
            self._is_due = True
            self._commit_later()

    def _commit_later(self) -> None:
        self._clock.at(self._clock.now_us + LAZY_COMMIT_US, self._commit_lazily)

    def _commit_lazily(self) -> None:
        if self._pace.is_frozen:
            self._commit_later()
        elif not self._pace.is_over:
            self._is_due = False
            self._journal.commit()
