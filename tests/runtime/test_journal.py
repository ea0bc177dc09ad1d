"""The journal: what is committed is there after any end of the process, and nothing stops it."""

from __future__ import annotations

import random
import shutil
import sqlite3
import subprocess
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mrbt_mesh.core.facts.store import BatchProof, Entry, Incarnation, Version, parse_entry
from mrbt_mesh.runtime import journal as journal_module
from mrbt_mesh.runtime.journal import Journal, journal_path, read_journals, reason_of
from tests.support.disks import fill, small_disk

MISSION, RUN = "d" * 64, "run1"
VALUES: dict[str, Any] = {"claim": None, "problem/clock": "it is wrong"}


class Diary:
    """Collects what a journal logs."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str, dict[str, Any]]] = []

    def __call__(self, level: str, event: str, **fields: Any) -> None:
        self.lines.append((level, event, fields))

    @property
    def events(self) -> list[str]:
        return [event for _, event, _ in self.lines]


def journal(path: Path, diary: Diary | None = None, run: str = RUN) -> Journal:
    return Journal(path, MISSION, run, "A1", diary or Diary())


def put(to: Journal, *entries: Entry) -> None:
    to.write({(each.author, each.name): each for each in entries})


def entry(author: str = "A1", sequence: int = 1, value: Any = None, name: str = "claim") -> Entry:
    return parse_entry(author, name, Version(Incarnation(1, "n"), sequence), value)


def outcome(number: int, data: Any = None) -> Entry:
    return entry(name=f"outcome/run1:1:a::{number}/a", sequence=number, value=[True, data])


def test_what_was_written_is_there_again(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    first = journal(path)
    assert first.open() == ()
    kept = [outcome(1), outcome(2, {"speed": 1.5}), entry("B1", 7)]
    put(first, *kept)
    # The process dies here: nothing is closed.
    diary = Diary()
    again = journal(path, diary).open()
    assert sorted(again, key=str) == sorted(kept, key=str)
    assert diary.events == []


def test_the_proof_of_a_batch_is_kept_as_long_as_an_entry_of_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal_module, "COMMITS_PER_CLEANING", 2)
    path = tmp_path / "A1.journal"
    first = journal(path)
    first.open()
    proofs = [BatchProof(bytes(32), bytes(64)), BatchProof(b"x" * 32, b"y" * 64)]
    version = Version(Incarnation(1, "n"), 1)
    for name in ("claim", "problem/clock"):
        put(first, parse_entry("A1", name, version, VALUES[name], proofs[0]))
    put(first, entry("B1"))
    first.close()
    again = journal(path)
    assert [each.proof for each in again.open()] == [proofs[0], proofs[0], None]
    for name in ("claim", "problem/clock"):
        version = Version(Incarnation(1, "n"), 2)
        put(again, parse_entry("A1", name, version, VALUES[name], proofs[1]))
    put(again, entry("B1"))
    again.close()
    assert [each.proof for each in journal(path).open()] == [proofs[1], proofs[1], None]
    (rows,) = sqlite3.connect(path).execute("SELECT COUNT(*) FROM proofs").fetchone()
    assert rows == 1


def test_what_is_forgotten_is_gone_and_may_come_back(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    first = journal(path)
    first.open()
    put(first, outcome(1), outcome(2))
    first.write({("A1", outcome(1).name): None, ("A1", "never/there"): None})
    first.write({("A1", outcome(2).name): None})
    put(first, outcome(2))
    first.close()
    assert [found.name for found in journal(path).open()] == [outcome(2).name]


def held(path: Path) -> tuple[set[bytes], Diary]:
    diary = Diary()
    opened = journal(path, diary)
    found = opened.open()
    opened.close()
    return {each.hash for each in found}, diary


@settings(max_examples=40)
@given(cut=st.integers(0, 100), noise=st.binary(max_size=64))
@example(cut=0, noise=b"\0")
def test_a_torn_or_corrupt_journal_never_stops_a_robot(
    tmp_path_factory: pytest.TempPathFactory, cut: int, noise: bytes
) -> None:
    path = tmp_path_factory.mktemp("journal") / "A1.journal"
    first = journal(path)
    first.open()
    put(first, *(outcome(number) for number in range(200)))
    first.close()
    whole = path.read_bytes()
    place = len(whole) * cut // 100
    torn = whole[:place] + noise
    path.write_bytes(torn)
    diary = Diary()
    second = journal(path, diary)
    found = {each.hash for each in second.open()}
    everything = {outcome(number).hash for number in range(200)}
    assert found == everything or diary.events == ["journal_set_aside"] or not torn
    put(second, outcome(500))
    second.close()
    assert outcome(500) in journal(path).open()
    if "journal_set_aside" in diary.events:
        kept = next(fields["kept_as"] for _, _, fields in diary.lines if "kept_as" in fields)
        assert Path(kept).read_bytes() == torn


def test_journals_that_cannot_be_used_are_named_to_who_reads_them(tmp_path: Path) -> None:
    for robot in ("A1", "B1"):
        first = Journal(journal_path(tmp_path, robot), MISSION, RUN, robot, Diary())
        first.open()
        put(first, entry(robot))
        first.close()
    damaged = journal_path(tmp_path, "B1")
    damaged.write_bytes(b"no database")
    problems: list[str] = []
    found = read_journals(tmp_path, ("A1", "B1", "C1"), MISSION, RUN, problems.append)
    assert found == {"A1": (entry("A1"),), "B1": (), "C1": ()}
    assert problems == [f"{damaged} cannot be used: damaged: file is not a database"]
    (tmp_path / "C1.process").touch()
    journal_path(tmp_path, "A1").write_bytes(b"")
    problems.clear()
    assert read_journals(tmp_path, ("A1", "C1"), MISSION, RUN, problems.append) == {
        "A1": (),
        "C1": (),
    }
    lost = "what no other robot knows of it is lost"
    assert problems == [
        f"{journal_path(tmp_path, 'A1')} is empty: {lost}",
        f"{journal_path(tmp_path, 'C1')} is missing: {lost}",
    ]
    emptied = Journal(journal_path(tmp_path, "A1"), MISSION, RUN, "A1", Diary())
    assert (emptied.open(), emptied.set_aside_text) == (
        (),
        f"journal is empty, as if this robot had never written to it: {lost}",
    )
    emptied.close()
    second = Journal(damaged, MISSION, RUN, "B1", Diary())
    assert second.open() == ()
    assert second.set_aside_text == (
        "journal damaged: file is not a database; it is kept as B1.journal.aside-1, "
        "and what no other robot knows of it is lost"
    )
    second.close()


def flipped(path: Path, bit: int) -> bytes:
    data = bytearray(path.read_bytes())
    data[bit // 8] ^= 1 << bit % 8
    return bytes(data)


@pytest.mark.slow
@pytest.mark.parametrize("is_crashed", [False, True], ids=["closed", "crashed"])
def test_a_bit_that_has_changed_loads_the_same_facts_or_is_noticed(
    tmp_path: Path, is_crashed: bool
) -> None:
    """In the file itself, or, after a crash, in the write-ahead log that the file lacks."""
    path = tmp_path / "A1.journal"
    first = journal(path)
    first.open()
    proof = BatchProof(b"h" * 32, b"s" * 64)
    version = Version(Incarnation(1, "n"), 1)
    put(first, outcome(1), outcome(2, {"speed": 1.5}), entry("B1", 7))
    put(first, parse_entry("A1", "problem/clock", version, VALUES["problem/clock"], proof))
    put(first, outcome(3))
    wal = path.with_name("A1.journal-wal")
    if not is_crashed:
        first.close()
    everything = {each.hash for each in journal(path).open()}
    assert len(everything) == 5
    spoiled = wal if is_crashed else path
    files = {part: part.read_bytes() for part in (path, wal) if part.exists()}
    pick = random.Random(1)
    whole = spoiled.read_bytes()
    # Most of the bits are those of empty pages.
    bits = [bit for bit in range(8 * len(whole)) if whole[bit // 8]]
    noticed = 0
    for bit in pick.sample(bits, 300):
        folder = tmp_path / f"flip-{bit}"
        folder.mkdir()
        for part, data in files.items():
            (folder / part.name).write_bytes(data)
        copy = folder / spoiled.name
        copy.write_bytes(flipped(copy, bit))
        found, diary = held(folder / path.name)
        assert found == everything or diary.events, (bit, found)
        noticed += bool(diary.events)
    assert noticed > 200


def test_rows_that_belong_to_no_journal_are_damage(tmp_path: Path) -> None:
    changes = [
        "UPDATE entries SET value = x'ff00'",
        "UPDATE entries SET value = 'text'",
        "UPDATE entries SET sequence = NULL",
        "UPDATE entries SET digest = 'x'",
        "DELETE FROM entries WHERE name LIKE '%::1/%'",
        "DELETE FROM meta WHERE key = 'digest'",
        "UPDATE meta SET value = 7 WHERE key = 'digest'",
        "DROP TABLE proofs",
        "ALTER TABLE entries RENAME TO others",
    ]
    for number, change in enumerate(changes):
        path = tmp_path / f"{number}.journal"
        first = journal(path)
        first.open()
        put(first, outcome(1), outcome(2))
        first.close()
        with sqlite3.connect(path) as database:
            database.execute(change)
        database.close()
        found, diary = held(path)
        assert (found, diary.events) == (set(), ["journal_set_aside"]), change


def test_a_journal_of_another_run_is_set_aside_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    old = journal(path, run="before")
    old.open()
    put(old, outcome(1))
    old.close()
    diary = Diary()
    assert journal(path, diary).open() == ()
    ((_, event, fields),) = diary.lines
    assert event == "journal_set_aside"
    assert fields["reason"] == "belongs to another run"
    assert Path(fields["kept_as"]).exists()
    third = journal(path, run="later")
    assert third.open() == ()
    assert len(list(tmp_path.glob("A1.journal.aside-*"))) >= 2


# -- what a journal cannot do now -------------------------------------------------------------


def written(path: Path, is_closed: bool = True) -> Journal:
    first = journal(path)
    first.open()
    put(first, outcome(1), outcome(2))
    if is_closed:
        first.close()
    return first


def test_a_lock_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    written(path)
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    diary = Diary()
    second = journal(path, diary)
    entries, _ = second.begin()
    assert len(entries) == 2
    with pytest.raises(sqlite3.OperationalError) as raised:
        put(second, outcome(3))
    assert reason_of(raised.value) == "it is locked by another process"
    other.execute("ROLLBACK")
    put(second, outcome(3))
    assert diary.events == []


def test_a_lock_that_keeps_others_from_reading_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    written(path)
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("PRAGMA locking_mode=EXCLUSIVE")
    other.execute("BEGIN EXCLUSIVE")
    diary = Diary()
    second = journal(path, diary)
    entries, problem = second.begin()
    assert (len(entries), problem) == (2, "it is locked by another process")
    assert not second.is_open
    other.close()
    assert len(second.open()) == 2
    put(second, outcome(3))
    assert diary.events == []


@pytest.mark.parametrize("is_closed", [True, False], ids=["closed", "crashed"])
@pytest.mark.parametrize(
    ("how", "reason"), [("full", "No space left on device"), ("read-only", "it ")]
)
def test_a_disk_that_cannot_be_written_is_read_all_the_same(
    tmp_path: Path, how: str, reason: str, is_closed: bool
) -> None:
    with small_disk(tmp_path / "disk") as disk:
        check_bad_disk(disk, tmp_path, how, reason, is_closed)


def check_bad_disk(tmpfs: Path, tmp_path: Path, how: str, reason: str, is_closed: bool) -> None:
    source = tmp_path / "A1.journal"
    written(source, is_closed)
    path = tmpfs / "A1.journal"
    for part in tmp_path.glob("A1.journal*"):
        if not part.name.endswith("-shm"):
            shutil.copyfile(part, tmpfs / part.name)
    if how == "full":
        fill(tmpfs)
    else:
        subprocess.run(["mount", "-o", "remount,ro", str(tmpfs)], check=True)
    diary = Diary()
    opened = journal(path, diary)
    entries, problem = opened.begin()
    assert len(entries) == 2
    if opened.is_open:
        with pytest.raises(sqlite3.Error) as raised:
            put(opened, outcome(3, "x" * 100_000))
        problem = reason_of(raised.value)
    assert reason in problem or "disk I/O" in problem
    opened.close()
    if how == "full":
        (tmpfs / "filler").unlink()
    else:
        subprocess.run(["mount", "-o", "remount,rw", str(tmpfs)], check=True)
    assert len(opened.open()) == 2
    put(opened, outcome(3))
    opened.close()
    assert diary.events == []


def test_a_journal_that_was_deleted_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    first = written(path, is_closed=False)
    assert not first.has_moved()
    path.unlink()
    assert first.has_moved()
    assert first.open() == ()
    assert not first.has_moved()


def test_a_folder_that_cannot_be_written_leaves_a_robot_without_a_journal(tmp_path: Path) -> None:
    lost = journal(tmp_path / "nowhere" / "A1.journal")
    assert lost.begin() == ((), "it cannot be opened")
    lost.close()
