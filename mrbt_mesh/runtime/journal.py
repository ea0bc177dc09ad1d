"""A robot's journal: the facts that it must not lose, in its run directory.

SQLite in WAL mode: one file format that survives a crash at any byte, in the standard
library, at about 0.1 ms for a synced commit. What the robot itself says (its claims, outcomes
and incarnations) is synced before it is told to anybody; what others told it is written a
little later, since they have it too.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import msgpack

from mrbt_mesh.core.facts.store import BatchProof, Entry, Incarnation, Version, make_entry

SCHEMA_VERSION = 2
SUFFIX = ".journal"
LAZY_COMMIT_S = 0.1

_TABLES = """
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS entries (
    author TEXT, name TEXT, counter INTEGER, nonce TEXT, sequence INTEGER, value BLOB,
    PRIMARY KEY (author, name)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS proofs (
    author TEXT, counter INTEGER, nonce TEXT, sequence INTEGER, hashes BLOB, signature BLOB,
    PRIMARY KEY (author, counter, nonce, sequence)
) WITHOUT ROWID;
"""
# Proofs of batches of which no entry stands are dropped now and then.
_DROP_PROOFS = """
DELETE FROM proofs WHERE (author, counter, nonce, sequence) NOT IN
    (SELECT author, counter, nonce, sequence FROM entries)
"""
COMMITS_PER_CLEANING = 1_000


class Journal:
    """The journal of one robot in one run.

    `log(level, event, **fields)` is told of everything unusual; nothing here ever stops the
    robot. Entries that could not be written (the disk is full) are kept and tried again.
    """

    def __init__(
        self, path: Path, mission: str, run: str, robot: str, log: Callable[..., None]
    ) -> None:
        self._path = path
        self._meta = {
            "schema": str(SCHEMA_VERSION),
            "mission": mission,
            "run": run,
            "robot": robot,
        }
        self._log = log
        self._pending: dict[tuple[str, str], Entry | None] = {}
        self._failing = False
        self._commits = 0
        self._database: sqlite3.Connection | None = None

    def open(self) -> tuple[Entry, ...]:
        """Open or create the journal; returns what it holds.

        A damaged journal, or one of another run, is set aside, and the robot starts without.
        """
        try:
            return self._open()
        except (sqlite3.Error, ValueError) as error:
            self._set_aside(str(error))
        try:
            return self._open()
        except sqlite3.Error as error:
            self._fail(error)
            return ()

    def _open(self) -> tuple[Entry, ...]:
        self._database = sqlite3.connect(self._path, isolation_level=None, timeout=1.0)
        database = self._database
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA synchronous=FULL")
        (state,) = database.execute("PRAGMA quick_check(1)").fetchone()
        if state != "ok":
            raise ValueError(f"damaged: {state}")
        database.executescript(_TABLES)
        known = dict(database.execute("SELECT key, value FROM meta"))
        if not known:
            database.executemany("INSERT INTO meta VALUES (?, ?)", self._meta.items())
        elif known != self._meta:
            other = [key for key in self._meta if known.get(key) != self._meta[key]]
            raise ValueError(f"belongs to another {', '.join(other)}")
        database.execute(_DROP_PROOFS)
        shown = database.execute("SELECT * FROM proofs").fetchall()
        proofs = {row[:4]: BatchProof(row[4], row[5]) for row in shown}
        rows = database.execute("SELECT * FROM entries ORDER BY author, name").fetchall()
        return tuple(_entry(row, proofs.get((row[0], *row[2:5]))) for row in rows)

    def _set_aside(self, reason: str) -> None:
        """Move a journal that cannot be used out of the way, for people to look at."""
        if self._database is not None:
            self._database.close()
            self._database = None
        number = 1
        while (aside := self._path.with_name(f"{self._path.name}.aside-{number}")).exists():
            number += 1
        for suffix in ("", "-wal", "-shm"):
            part = self._path.with_name(self._path.name + suffix)
            if part.exists():
                part.rename(aside.with_name(aside.name + suffix))
        self._log("error", "journal_set_aside", reason=reason, kept_as=str(aside))

    def put(self, entries: Iterable[Entry]) -> None:
        """Take entries in; they are on disk after the next `commit`."""
        for entry in entries:
            self._pending[entry.author, entry.name] = entry

    def forget(self, keys: Iterable[tuple[str, str]]) -> None:
        """Drop entries, by author and name; they are gone from disk after the next `commit`."""
        for key in keys:
            self._pending[key] = None

    @property
    def is_clean(self) -> bool:
        """Whether everything that was put has been written."""
        return not self._pending

    def commit(self) -> bool:
        """Write and sync everything that was put; False if that failed, to be tried again."""
        if not self._pending:
            return True
        if self._database is None:
            return False
        rows = [
            (e.author, e.name, *e.version.incarnation, e.version.sequence, e.packed)
            for e in self._pending.values()
            if e is not None
        ]
        proofs = [
            (e.author, *e.version.incarnation, e.version.sequence, p.hashes, p.signature)
            for e in self._pending.values()
            if e is not None and (p := e.proof) is not None
        ]
        gone = [key for key, entry in self._pending.items() if entry is None]
        try:
            self._database.execute("BEGIN IMMEDIATE")
            self._database.executemany(
                "INSERT OR REPLACE INTO entries VALUES (?, ?, ?, ?, ?, ?)", rows
            )
            self._database.executemany(
                "INSERT OR REPLACE INTO proofs VALUES (?, ?, ?, ?, ?, ?)", proofs
            )
            self._commits += 1
            if self._commits % COMMITS_PER_CLEANING == 0:
                self._database.execute(_DROP_PROOFS)
            self._database.executemany("DELETE FROM entries WHERE author = ? AND name = ?", gone)
            self._database.execute("COMMIT")
        except sqlite3.Error as error:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
            self._fail(error)
            return False
        self._pending.clear()
        if self._failing:
            self._failing = False
            self._log("info", "journal_works_again")
        return True

    def _fail(self, error: sqlite3.Error) -> None:
        if not self._failing:
            self._failing = True
            self._log(
                "error",
                "journal_fails",
                error=str(error),
                consequence="a restart of this robot relies on what the others know",
            )

    def close(self) -> None:
        """Write what is left and close."""
        self.commit()
        if self._database is not None:
            self._database.close()
            self._database = None


def _entry(row: tuple[Any, ...], proof: BatchProof | None) -> Entry:
    author, name, counter, nonce, sequence, value = row
    version = Version(Incarnation(counter, nonce), sequence)
    return make_entry(author, name, version, msgpack.unpackb(value), proof)


def journal_path(run_dir: Path, robot: str) -> Path:
    """Where a robot keeps its journal."""
    return run_dir / f"{robot}{SUFFIX}"


def read_journals(
    run_dir: Path, robots: Iterable[str], mission: str, run: str
) -> dict[str, tuple[Entry, ...]]:
    """Robot -> the entries in its journal; one that is missing or unusable holds none.

    From copies: opening SQLite's files would repair and shorten them, which is left to their
    robot. It also says in its own log what is wrong with them.
    """
    found = {}
    with tempfile.TemporaryDirectory(prefix="mrbt-journals-") as folder:
        for robot in robots:
            for part in run_dir.glob(f"{robot}{SUFFIX}*"):
                if ".aside-" not in part.name and not part.name.endswith("-shm"):
                    shutil.copy(part, folder)
            journal = Journal(journal_path(Path(folder), robot), mission, run, robot, _ignore)
            found[robot] = journal.open()
            journal.close()
    return found


def _ignore(level: str, event: str, **fields: Any) -> None:
    pass
