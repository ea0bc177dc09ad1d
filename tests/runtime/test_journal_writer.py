"""When facts reach the journal, and what is told of it: by a thread, whatever the disk does."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Mapping
from typing import Any

import pytest

from mrbt_mesh.core.agent.effects import Forget, Persist
from mrbt_mesh.core.agent.inputs import JournalOpened, JournalReported, JournalSynced
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, parse_entry
from mrbt_mesh.runtime import journal_writer
from mrbt_mesh.runtime.journal_writer import JournalWriter

TIMEOUT_S = 60


def entry(number: int) -> Entry:
    return parse_entry("A1", "claim", Version(Incarnation(1, "n"), number), None)


class Disk:
    """A journal in memory: it fails with each of `errors` once, and its writes wait for `free`."""

    def __init__(self) -> None:
        self.is_open = True
        self.moved = False
        self.set_aside_text = ""
        self.entries: dict[tuple[str, str], Entry | None] = {}
        self.writes: list[int] = []
        self.errors: list[Exception] = []
        self.free = threading.Event()
        self.began: queue.Queue[int] = queue.Queue()
        self.free.set()

    def open(self) -> tuple[Entry, ...]:
        if self.errors:
            raise self.errors.pop(0)
        self.is_open, self.moved = True, False
        return tuple(each for each in self.entries.values() if each is not None)

    def has_moved(self) -> bool:
        return self.moved

    def write(self, changes: Mapping[tuple[str, str], Entry | None]) -> None:
        self.began.put(len(changes))
        assert self.free.wait(TIMEOUT_S)
        if self.errors:
            raise self.errors.pop(0)
        self.entries |= changes
        self.writes.append(len(changes))

    def close(self) -> None:
        self.is_open = False


class Writing:
    """A writer at work, and its news in order."""

    def __init__(self, problem: str = "") -> None:
        self.disk = Disk()
        self.disk.is_open = not problem
        self._news: queue.Queue[Any] = queue.Queue()
        self.writer = JournalWriter(self.disk, self._news.put, problem)  # type: ignore[arg-type]

    def __enter__(self) -> Writing:
        self.writer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.disk.free.set()
        self.writer.close()

    def news(self) -> Any:
        return self._news.get(timeout=TIMEOUT_S)

    def has_no_news(self) -> bool:
        return self._news.empty()


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RETRY_S", "LOOK_S", "LAZY_COMMIT_S"):
        monkeypatch.setattr(journal_writer, name, 0.01)


def test_what_is_to_be_known_is_told_once_it_is_on_disk() -> None:
    with Writing() as at:
        at.disk.free.clear()
        at.writer.carry_out(Persist((entry(1),), True, 1))
        assert at.disk.began.get(timeout=TIMEOUT_S) == 1
        assert at.has_no_news()
        at.disk.free.set()
        assert at.news() == JournalSynced(1)
        assert at.disk.entries["A1", "claim"] == entry(1)


def test_all_that_waits_is_written_together() -> None:
    with Writing() as at:
        at.disk.free.clear()
        at.writer.carry_out(Persist((entry(1),), True, 1))
        at.disk.began.get(timeout=TIMEOUT_S)
        for number in range(2, 9):
            other = parse_entry(f"B{number}", "claim", Version(Incarnation(1, "n"), 1), None)
            at.writer.carry_out(Persist((other,), True, number))
        at.writer.carry_out(Forget((("A1", "claim"),)))
        at.disk.free.set()
        assert [at.news(), at.news()] == [JournalSynced(1), JournalSynced(8)]
        assert at.disk.writes == [1, 8]
        assert at.disk.entries["A1", "claim"] is None


def test_what_fails_is_said_once_and_tried_again() -> None:
    full = OSError(28, "No space left on device")
    with Writing() as at:
        at.disk.errors = [full, full, full]
        at.writer.carry_out(Persist((entry(1),), True, 1))
        text = "journal cannot be written: No space left on device"
        assert at.news() == JournalReported(text, is_failing=True)
        assert at.news() == JournalReported("")
        assert at.news() == JournalSynced(1)
        assert at.disk.errors == []


def test_what_is_put_while_a_write_fails_replaces_it() -> None:
    with Writing() as at:
        at.disk.free.clear()
        at.disk.errors = [OSError(28, "No space left on device")]
        at.writer.carry_out(Persist((entry(1),), True, 1))
        at.disk.began.get(timeout=TIMEOUT_S)
        at.writer.carry_out(Persist((entry(2),), True, 2))
        at.disk.free.set()
        assert isinstance(at.news(), JournalReported)
        assert [at.news(), at.news()] == [JournalReported(""), JournalSynced(2)]
        assert at.disk.entries["A1", "claim"] == entry(2)


def test_whatever_goes_wrong_is_said() -> None:
    with Writing() as at:
        at.disk.errors = [ZeroDivisionError("surprise")]
        at.writer.carry_out(Persist((entry(1),), True, 1))
        assert at.news() == JournalReported("journal cannot be written: surprise", is_failing=True)


def test_a_journal_that_could_not_be_opened_is_opened_later() -> None:
    at = Writing("journal cannot be written: it is locked by another process")
    at.disk.entries = {("B1", "claim"): entry(7)}
    at.disk.errors = [OSError(0, "it is locked by another process")] * 3
    at.writer.carry_out(Persist((entry(1),), True, 1))
    with at:
        assert at.news() == JournalOpened((entry(7),))
        assert [at.news(), at.news()] == [JournalReported(""), JournalSynced(1)]


def test_a_journal_that_was_set_aside_is_said_as_long_as_the_robot_lives() -> None:
    with Writing() as at:
        at.disk.set_aside_text = (
            "journal damaged: it has no tables; it is kept as A1.journal.aside-1"
        )
        at.writer.carry_out(Persist((entry(1),), True, 1))
        assert at.news() == JournalReported(at.disk.set_aside_text, is_failing=False)
        assert at.news() == JournalSynced(1)
        at.writer.carry_out(Persist((entry(2),), True, 2))
        assert at.news() == JournalSynced(2)


def test_a_journal_that_is_deleted_is_noticed_though_nothing_is_written() -> None:
    with Writing() as at:
        at.disk.moved = True
        said = JournalReported("journal was deleted while the robot ran", is_failing=True)
        assert at.news() == said
        assert at.news() == JournalOpened(())
        assert at.news() == JournalReported("")


def test_a_slow_disk_is_reported_until_it_was_fast_for_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [0.0]
    monkeypatch.setattr(journal_writer.time, "monotonic", lambda: clock[0])
    at = Writing()
    slow = JournalReported("journal is slow: writes take more than 0.25 s")
    for at_s, took_s, told in (
        (0, 0.01, None),
        (1, 0.5, slow),
        (20, 0.6, None),
        (49, 0.01, None),
        (50, 0.01, JournalReported("")),
    ):
        clock[0] = at_s
        at.writer._worked(took_s, 0)
        assert at.has_no_news() if told is None else at.news() == told


def test_waiting_for_a_processor_is_no_slow_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    waited_s = iter((3.0, 4.0))
    monkeypatch.setattr(journal_writer, "processor_wait_s", lambda: next(waited_s))
    took_s: list[float] = []
    at = Writing()
    monkeypatch.setattr(at.writer, "_worked", lambda seconds, number: took_s.append(seconds))
    at.disk.is_open = True
    at.writer._write(at.disk)
    assert took_s == [0.0]


def test_at_the_end_what_waits_is_written() -> None:
    with Writing() as at:
        at.writer.carry_out(Persist((entry(1),), False, 0))
        assert at.writer.close() == 0
        assert at.disk.entries["A1", "claim"] == entry(1)
        assert not at.disk.is_open


def test_the_end_waits_for_no_disk_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_writer, "CLOSE_TIMEOUT_S", 0.01)
    with Writing() as at:
        at.disk.free.clear()
        at.writer.carry_out(Persist((entry(1),), True, 0))
        at.disk.began.get(timeout=TIMEOUT_S)
        began_s = time.monotonic()
        assert at.writer.close() == 1
        assert time.monotonic() - began_s < TIMEOUT_S / 2


def test_without_a_journal_nothing_happens() -> None:
    nowhere = JournalWriter(None, lambda news: None)
    nowhere.start()
    nowhere.carry_out(Persist((entry(1),), True, 1))
    nowhere.carry_out(Forget((("A1", "claim"),)))
    assert nowhere.close() == 0
