"""When facts reach the journal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import anyio
import pytest

from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry
from mrbt_mesh.runtime import journal_writer
from mrbt_mesh.runtime.journal_writer import JournalWriter

ENTRY = make_entry("A1", "claim", Version(Incarnation(1, "n"), 1), None)


class Kept:
    """A journal in memory; the first commits fail, as on a full disk."""

    def __init__(self, failures: int = 0) -> None:
        self.story: list[Any] = []
        self.committed = anyio.Event()
        self._failures = failures

    def put(self, entries: Iterable[Entry]) -> None:
        self.story += [entry.name for entry in entries]

    def forget(self, keys: Iterable[tuple[str, str]]) -> None:
        self.story += [("gone", *key) for key in keys]

    def commit(self) -> bool:
        self._failures -= 1
        self.story.append("failed" if self._failures >= 0 else "commit")
        if self._failures < 0:
            self.committed.set()
        return self._failures < 0

    def close(self) -> None:
        self.story.append("close")


def writer(kept: Kept) -> JournalWriter:
    return JournalWriter(kept)  # type: ignore[arg-type]


async def test_what_must_not_be_lost_is_written_at_once() -> None:
    kept = Kept()
    writer(kept).put([ENTRY], synced=True)
    assert kept.story == ["claim", "commit"]


async def test_the_rest_is_written_later_and_together() -> None:
    kept = Kept()
    to_journal = writer(kept)
    to_journal.put([ENTRY], synced=False)
    to_journal.forget([("B1", "claim")])
    to_journal.put([ENTRY], synced=False)
    assert "commit" not in kept.story
    await kept.committed.wait()
    assert kept.story == ["claim", ("gone", "B1", "claim"), "claim", "commit"]


async def test_it_is_tried_again_until_it_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_writer, "RETRY_COMMIT_S", 0.0)
    kept = Kept(failures=3)
    writer(kept).put([ENTRY], synced=False)
    await kept.committed.wait()
    assert kept.story == ["claim", "failed", "failed", "failed", "commit"]


async def test_after_the_end_nothing_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_writer, "LAZY_COMMIT_S", 0.0)
    kept = Kept()
    to_journal = writer(kept)
    to_journal.put([ENTRY], synced=False)
    to_journal.close()
    for _ in range(3):
        await anyio.lowlevel.checkpoint()
    assert kept.story == ["claim", "close"]


async def test_without_a_journal_nothing_happens() -> None:
    nowhere = JournalWriter(None)
    nowhere.put([ENTRY], synced=True)
    nowhere.forget([("A1", "claim")])
    nowhere.close()
