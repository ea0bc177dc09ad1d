"""A journal in the simulator, and its disk: what is kept when a process dies at any moment.

Works as `runtime.journal` and `runtime.journal_writer`: what is put waits, and is written and
synced together; what is not on disk yet is lost with the process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from mrbt_mesh.core.agent.effects import Forget, Persist
from mrbt_mesh.core.agent.inputs import JournalOpened, JournalReported, JournalSynced
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.runtime.journal import changes_of
from mrbt_mesh.runtime.journal_writer import LAZY_COMMIT_S, RETRY_S, JournalNews
from mrbt_mesh.sim.world.clock import MICRO, VirtualClock
from mrbt_mesh.sim.world.pace import Pace

LAZY_COMMIT_US, RETRY_US = round(LAZY_COMMIT_S * MICRO), round(RETRY_S * MICRO)
FULL = "journal cannot be written: No space left on device"

Changes = Mapping[tuple[str, str], Entry | None]


class SimJournal:
    """The journal of one robot, on a disk; it outlives the robot's processes.

    `sync_us`: how long a sync takes. `fails`: nothing can be written; `is_locked`: nor read.
    """

    def __init__(self) -> None:
        self.sync_us = 0
        self.fails = False
        self.is_locked = False
        self._written: dict[tuple[str, str], Entry] = {}

    def write(self, changes: Changes) -> None:
        """From now on this is on disk."""
        for key, entry in changes.items():
            if entry is None:
                self._written.pop(key, None)
            else:
                self._written[key] = entry

    def read(self) -> tuple[Entry, ...]:
        """What a new process finds."""
        return tuple(self._written[key] for key in sorted(self._written))


class SimJournalWriter:
    """What one process writes to its robot's journal: at once, or a little later together.

    `notify` hands its news to the agent; `synced` is called with what is on disk from now on.
    `is_read`: the process knows what the journal held at its start.
    """

    def __init__(
        self,
        journal: SimJournal,
        clock: VirtualClock,
        pace: Pace,
        notify: Callable[[JournalNews], None],
        synced: Callable[[Changes], None],
    ) -> None:
        self.is_read = not journal.is_locked
        self._journal = journal
        self._clock = clock
        self._pace = pace
        self._notify = notify
        self._synced = synced
        self._pending: dict[tuple[str, str], Entry | None] = {}
        self._number = self._notified = 0
        # When the next commit begins; None: none is due. `_is_syncing`: one is under way.
        self._due_us: int | None = None
        self._is_syncing = False
        self._is_failing = journal.fails or journal.is_locked

    def start(self) -> None:
        """The agent is there."""
        if self._is_failing:
            self._commit_by(self._clock.now_us + RETRY_US)

    def carry_out(self, effect: Persist | Forget) -> None:
        """Write entries, or drop them, with all that waits: at once, or a little later."""
        self._pending.update(changes_of(effect))
        is_urgent = isinstance(effect, Persist) and effect.at_once
        if isinstance(effect, Persist):
            self._number = max(self._number, effect.number)
        if not self._is_failing:
            self._commit_by(self._clock.now_us + (0 if is_urgent else LAZY_COMMIT_US))

    def end(self) -> None:
        """The process ends by itself: what waits is written, if that is possible."""
        if not self._journal.fails and not self._journal.is_locked:
            self._write(dict(self._pending))

    def _commit_by(self, at_us: int) -> None:
        if self._due_us is None or at_us < self._due_us:
            self._due_us = at_us
            self._clock.at(at_us, partial(self._commit, at_us))

    def _commit(self, due_us: int) -> None:
        if self._due_us != due_us or self._is_syncing or self._pace.is_over:
            return  # an earlier one has replaced it, or the next one begins after this one
        self._due_us = None
        if self._pace.is_frozen:
            self._commit_by(self._clock.now_us + LAZY_COMMIT_US)
            return
        self._is_syncing = True
        at_us = self._clock.now_us + self._journal.sync_us
        sync = partial(self._sync, dict(self._pending), self._number)
        if self._journal.sync_us:
            self._clock.at(at_us, sync)
        else:
            sync()

    def _sync(self, changes: Changes, number: int) -> None:
        """The disk has had its time; a process that was killed meanwhile has written nothing."""
        if self._pace.is_over:
            return
        if self._pace.is_frozen:
            later_us = self._clock.now_us + LAZY_COMMIT_US
            self._clock.at(later_us, partial(self._sync, changes, number))
            return
        self._is_syncing = False
        # What was to be written meanwhile has found the disk busy.
        due_us, self._due_us = self._due_us, None
        if self._journal.fails or self._journal.is_locked:
            if not self._is_failing:
                self._is_failing = True
                self._notify(JournalReported(FULL, is_failing=True))
            self._commit_by(self._clock.now_us + RETRY_US)
            return
        if not self.is_read:
            self.is_read = True
            self._notify(JournalOpened(self._journal.read()))
        self._write(changes)
        for key, entry in changes.items():
            if key in self._pending and self._pending[key] is entry:
                del self._pending[key]
        if self._is_failing:
            self._is_failing = False
            self._notify(JournalReported(""))
        if number > self._notified:
            self._notified = number
            self._notify(JournalSynced(number))
        if self._pending:
            now_us = self._clock.now_us
            self._commit_by(now_us if due_us is None else max(now_us, due_us))

    def _write(self, changes: Changes) -> None:
        self._journal.write(changes)
        self._synced(changes)
