"""Writes a robot's facts to its journal in a thread.

A disk may take a second for a sync, and the robot must beat meanwhile. All waiting facts are
written and synced together.
"""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, TypeAlias

from mrbt_mesh.core.agent.effects import Forget, Persist
from mrbt_mesh.core.agent.inputs import JournalOpened, JournalReported, JournalSynced
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.runtime.journal import Journal, changes_of, reason_of

# How long facts may wait that other robots have as well.
LAZY_COMMIT_S = 0.1
RETRY_S = 1.0
# How often to check that an idle journal still exists.
LOOK_S = 1.0
# A longer write is reported; the report ends after SLOW_FOR_S without one, because each change of
# it is sent to the whole team.
SLOW_S = 0.25
SLOW_FOR_S = 30.0
SLOW = f"journal is slow: writes take more than {SLOW_S} s"
DELETED = "was deleted while the robot ran"
CLOSE_TIMEOUT_S = 5.0

JournalNews: TypeAlias = JournalSynced | JournalReported | JournalOpened


class Durations(Protocol):
    """Observes durations."""

    def observe(self, seconds: float) -> None: ...


class JournalWriter:
    """Writes to a journal; does nothing without one.

    `tell` is called in the writer's thread, with inputs for the agent. `problem`: why the journal
    could not be opened at the start, empty if it is open. `synced_s` observes how long each write
    took.
    """

    def __init__(
        self,
        journal: Journal | None,
        tell: Callable[[JournalNews], None],
        problem: str = "",
        synced_s: Durations | None = None,
    ) -> None:
        self._journal = journal
        self._tell = tell
        self._synced_s = synced_s
        self._changed = threading.Condition()
        self._pending: dict[tuple[str, str], Entry | None] = {}
        self._number = self._told = 0
        self._due_s: float | None = time.monotonic() if problem else None
        self._is_failing = bool(problem)
        self._reported = problem
        self._slow_at_s = -SLOW_FOR_S
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)

    def start(self) -> None:
        """Start writing; until then, changes wait."""
        if self._journal is not None:
            self._thread.start()

    def carry_out(self, effect: Persist | Forget) -> None:
        """Write or drop entries together with all that wait, at once or a little later.

        If the effect has a number, JournalSynced reports when they and all before them are on disk.
        """
        if self._journal is None:
            return
        is_urgent = isinstance(effect, Persist) and effect.at_once
        with self._changed:
            self._pending |= changes_of(effect)
            if isinstance(effect, Persist):
                self._number = max(self._number, effect.number)
            if not self._is_failing:
                due_s = time.monotonic() + (0 if is_urgent else LAZY_COMMIT_S)
                self._due_s = due_s if self._due_s is None else min(due_s, self._due_s)
                self._changed.notify()

    def close(self) -> int:
        """Write what waits and close the journal; return how many entries are not on disk.

        Blocks until all are, at most for `CLOSE_TIMEOUT_S`.
        """
        if self._journal is None:
            return 0
        with self._changed:
            self._is_closing = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(CLOSE_TIMEOUT_S)
        else:
            self._journal.close()
        return len(self._pending)

    # -- in the thread ------------------------------------------------------------------------

    def _run(self) -> None:
        assert self._journal is not None
        while not self._is_closing:
            with self._changed:
                wait_s = LOOK_S
                if self._due_s is not None:
                    wait_s = min(wait_s, self._due_s - time.monotonic())
                if wait_s > 0 and not self._is_closing:
                    self._changed.wait(wait_s)
                is_due = self._due_s is not None and self._due_s <= time.monotonic()
            if is_due or (self._journal.is_open and self._journal.has_moved()):
                self._write(self._journal)
        if self._pending:
            self._write(self._journal)
        self._journal.close()

    def _write(self, journal: Journal) -> None:
        """Write what waits, reopening the journal if necessary; failures are retried."""
        with self._changed:
            changes, number = dict(self._pending), self._number
            self._due_s = None
        began_s = time.monotonic() - processor_wait_s()
        try:
            self._ensure_open(journal)
            if changes:
                journal.write(changes)
                if journal.has_moved():
                    raise FileNotFoundError(errno.ENOENT, DELETED)
        except Exception as error:  # every error here must be reported
            self._failed(error)
            return
        took_s = max(0.0, time.monotonic() - processor_wait_s() - began_s)
        with self._changed:
            for key, entry in changes.items():
                if key in self._pending and self._pending[key] is entry:
                    del self._pending[key]
            self._is_failing = False
            if self._pending and self._due_s is None:
                self._due_s = time.monotonic()
        self._worked(took_s, number)

    def _ensure_open(self, journal: Journal) -> None:
        if journal.is_open and journal.has_moved():
            self._report(f"journal {DELETED}", is_failing=True)
            journal.close()
        if not journal.is_open:
            # What was on disk may be gone: the agent writes everything that it knows.
            self._tell(JournalOpened(journal.open()))

    def _failed(self, error: Exception) -> None:
        with self._changed:
            self._due_s = time.monotonic() + RETRY_S
            self._is_failing = True
        self._slow_at_s = -SLOW_FOR_S
        self._report(f"journal cannot be written: {reason_of(error)}", is_failing=True)

    def _worked(self, took_s: float, number: int) -> None:
        if self._synced_s is not None:
            self._synced_s.observe(took_s)
        now_s = time.monotonic()
        if took_s >= SLOW_S:
            self._slow_at_s = now_s
        is_slow = now_s < self._slow_at_s + SLOW_FOR_S
        assert self._journal is not None
        self._report(SLOW if is_slow else self._journal.set_aside_text)
        if number > self._told:
            self._told = number
            self._tell(JournalSynced(number))

    def _report(self, problem: str, *, is_failing: bool = False) -> None:
        if problem != self._reported:
            self._reported = problem
            self._tell(JournalReported(problem, is_failing))


def processor_wait_s() -> float:
    """Return how long this thread and the event loop's have waited for a processor so far.

    0.0 if the system does not say. It is subtracted so that a busy machine does not look like a
    slow disk.
    """
    try:
        files = ("/proc/thread-self/schedstat", "/proc/self/schedstat")
        return sum(int(Path(file).read_text(encoding="utf-8").split()[1]) for file in files) / 1e9
    except OSError:
        return 0.0
