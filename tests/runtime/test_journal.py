"""The journal: what is committed is there after any end of the process, and nothing stops it."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrbt_mesh.core.facts.records import Outcome
from mrbt_mesh.core.facts.store import BatchProof, Entry, Incarnation, Version, make_entry
from mrbt_mesh.runtime.journal import Journal

MISSION, RUN = "d" * 64, "run1"
VALUES: dict[str, Any] = {"claim": None, "order": ["pause", 1]}


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


def entry(author: str = "A1", sequence: int = 1, value: Any = None, name: str = "claim") -> Entry:
    return make_entry(author, name, Version(Incarnation(1, "n"), sequence), value)


def outcome(number: int, data: Any = None) -> Entry:
    return entry(name=f"outcome/run1:1:a::{number}/a", sequence=number, value=[True, data])


def test_what_was_committed_is_there_again_and_what_was_not_is_not(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    first = journal(path)
    assert first.open() == ()
    kept = [outcome(1), outcome(2, {"speed": 1.5}), entry("B1", 7)]
    first.put(kept)
    assert first.commit()
    first.put([outcome(3)])
    # The process dies here: nothing is closed.
    again = journal(path).open()
    assert sorted(again, key=str) == sorted(kept, key=str)


def test_the_proof_of_a_batch_is_kept_as_long_as_an_entry_of_it_stands(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    first = journal(path)
    first.open()
    proofs = [BatchProof(bytes(32), bytes(64)), BatchProof(b"x" * 32, b"y" * 64)]
    version = Version(Incarnation(1, "n"), 1)
    for name in ("claim", "order"):
        first.put([make_entry("A1", name, version, VALUES[name], proofs[0])])
    first.put([entry("B1")])
    first.commit()
    again = journal(path)
    assert [each.proof for each in again.open()] == [proofs[0], proofs[0], None]
    for name in ("claim", "order"):
        again.put(
            [make_entry("A1", name, Version(Incarnation(1, "n"), 2), VALUES[name], proofs[1])]
        )
        again.commit()
    assert [each.proof for each in journal(path).open()] == [proofs[1], proofs[1], None]
    (rows,) = sqlite3.connect(path).execute("SELECT COUNT(*) FROM proofs").fetchone()
    assert rows == 1


def test_a_newer_entry_of_a_key_replaces_the_older_one(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    first = journal(path)
    first.open()
    first.put([entry(sequence=1), entry(sequence=2, value=["run1:1:a::0", "a", "a", 2, 5, ""])])
    first.close()
    (found,) = journal(path).open()
    assert found.version.sequence == 2


def test_what_is_forgotten_is_gone_and_may_come_back(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    first = journal(path)
    first.open()
    first.put([outcome(1), outcome(2)])
    first.commit()
    first.forget([("A1", outcome(1).name), ("A1", outcome(2).name), ("A1", "never/there")])
    first.put([outcome(2)])
    first.close()
    assert [found.name for found in journal(path).open()] == [outcome(2).name]


@settings(max_examples=40)
@given(cut=st.integers(0, 100), noise=st.binary(max_size=64))
def test_a_torn_or_corrupt_journal_never_stops_a_robot(
    tmp_path_factory: pytest.TempPathFactory, cut: int, noise: bytes
) -> None:
    path = tmp_path_factory.mktemp("journal") / "A1.journal"
    first = journal(path)
    first.open()
    first.put([outcome(number) for number in range(200)])
    first.close()
    whole = path.read_bytes()
    place = len(whole) * cut // 100
    path.write_bytes(whole[:place] + noise)
    diary = Diary()
    second = journal(path, diary)
    found = second.open()
    assert {e.hash for e in found} <= {outcome(number).hash for number in range(200)}
    second.put([outcome(500)])
    assert second.commit()
    second.close()
    assert outcome(500) in journal(path).open()
    if "journal_set_aside" in diary.events:
        kept = next(fields["kept_as"] for _, _, fields in diary.lines if "kept_as" in fields)
        assert Path(kept).exists()


def test_a_journal_of_another_run_is_set_aside_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    old = journal(path, run="before")
    old.open()
    old.put([outcome(1)])
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


def test_a_full_disk_is_survived_reported_once_and_made_good_later(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    diary = Diary()
    full = journal(path, diary)
    full.open()
    database = full._database
    assert database is not None
    (pages,) = database.execute("PRAGMA page_count").fetchone()
    database.execute(f"PRAGMA max_page_count={pages}")
    full.put([outcome(number, "x" * 1_000) for number in range(50)])
    assert full.commit() is False
    full.put([outcome(99)])
    assert full.commit() is False
    assert diary.events == ["journal_fails"]
    assert "full" in diary.lines[0][2]["error"]
    database.execute("PRAGMA max_page_count=1000000")
    assert full.commit()
    assert full.is_clean
    assert diary.events == ["journal_fails", "journal_works_again"]
    full.close()
    assert len(journal(path).open()) == 51


def test_a_folder_that_cannot_be_written_leaves_a_robot_without_a_journal(tmp_path: Path) -> None:
    diary = Diary()
    lost = journal(tmp_path / "nowhere" / "A1.journal", diary)
    assert lost.open() == ()
    lost.put([outcome(1)])
    assert lost.commit() is False
    lost.close()
    assert "journal_fails" in diary.events


def test_an_entry_that_no_longer_parses_sets_the_journal_aside(tmp_path: Path) -> None:
    path = tmp_path / "A1.journal"
    first = journal(path)
    first.open()
    first.put([outcome(1)])
    first.close()
    with sqlite3.connect(path) as database:
        database.execute("UPDATE entries SET value = x'ff00'")
    database.close()
    diary = Diary()
    assert journal(path, diary).open() == ()
    assert diary.events == ["journal_set_aside"]


def test_the_reason_of_a_failure_is_kept_and_journals_from_before_there_were_any_are_read(
    tmp_path: Path,
) -> None:
    path = tmp_path / "A1.journal"
    first = journal(path)
    first.open()
    told = entry(name="outcome/run1:1:a::1/a", sequence=1, value=[False, None, "no path"])
    earlier = entry(name="outcome/run1:1:a::2/a", sequence=2, value=[False, {"n": 1}])
    first.put([told, earlier])
    assert first.commit()
    found = {each.name: each.record for each in journal(path).open()}
    assert found[told.name] == Outcome(False, None, "no path")
    assert found[earlier.name] == Outcome(False, {"n": 1}, "")
