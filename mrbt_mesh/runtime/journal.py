"""A robot's journal: the facts that it must not lose, stored in its run directory.

SQLite in WAL mode survives a crash at any byte and is in the standard library. It does not notice a
bit that has changed on the disk, so each row has a digest, and `meta` has the digest of all rows
together. Changed or missing rows are reported as damage.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import msgpack

from mrbt_mesh.core.agent.effects import Forget, Persist
from mrbt_mesh.core.facts.store import BatchProof, Entry, Incarnation, Version, parse_entry

FORMAT = 4
SUFFIX = ".journal"
BUSY_TIMEOUT_S = 1.0
PAGE_BYTES = 4096

# Author and name -> the entry to write, or None to delete it.
Changes: TypeAlias = Mapping[tuple[str, str], Entry | None]


def changes_of(effect: Persist | Forget) -> dict[tuple[str, str], Entry | None]:
    """Return an effect as changes to the journal."""
    if isinstance(effect, Persist):
        return {(entry.author, entry.name): entry for entry in effect.entries}
    return dict.fromkeys(effect.keys)


_TABLES = {
    "meta": "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID",
    "entries": (
        "CREATE TABLE entries (author TEXT, name TEXT, counter INTEGER, nonce TEXT, "
        "sequence INTEGER, value BLOB, digest INTEGER, PRIMARY KEY (author, name)) WITHOUT ROWID"
    ),
    "proofs": (
        "CREATE TABLE proofs (author TEXT, counter INTEGER, nonce TEXT, sequence INTEGER, "
        "hashes BLOB, signature BLOB, digest INTEGER, "
        "PRIMARY KEY (author, counter, nonce, sequence)) WITHOUT ROWID"
    ),
}
# Proofs of batches without remaining entries are deleted now and then.
_UNUSED_PROOFS = """
FROM proofs WHERE (author, counter, nonce, sequence) NOT IN
    (SELECT author, counter, nonce, sequence FROM entries)
"""
COMMITS_PER_CLEANING = 1_000
_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_FORMAT)
_REASONS = {
    sqlite3.SQLITE_FULL: os.strerror(errno.ENOSPC),
    sqlite3.SQLITE_READONLY: "it is read-only",
    sqlite3.SQLITE_BUSY: "it is locked by another process",
    sqlite3.SQLITE_CANTOPEN: "it cannot be opened",
}
# Errors that prevent reading or writing now. They may be temporary, and are no damage.
JOURNAL_ERRORS = (sqlite3.Error, OSError)


EMPTY = "journal is empty, as if this robot had never written to it"
LOST = "what no other robot knows of it is lost"


class DamagedError(Exception):
    """The journal does not hold what was written to it, or belongs to another run."""


def reason_of(error: Exception) -> str:
    """Return why a journal cannot be read or written, as readable text."""
    if isinstance(error, sqlite3.Error):
        return _REASONS.get(_code(error), str(error))
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def _code(error: sqlite3.Error) -> int:
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


class Journal:
    """The journal of one robot in one run, used by one thread at a time.

    `log(level, event, **fields)` is called for anything unusual about the file.
    """

    def __init__(
        self, path: Path, mission: str, run: str, robot: str, log: Callable[..., None]
    ) -> None:
        self.path = path
        self._meta = {"format": str(FORMAT), "mission": mission, "run": run, "robot": robot}
        self._log = log
        self._commits = 0
        self._database: sqlite3.Connection | None = None
        self._file: tuple[int, int] | None = None
        # Message about the last file that was empty or unusable; empty if there was none.
        self.set_aside_text = ""

    @property
    def is_open(self) -> bool:
        return self._database is not None

    def begin(self) -> tuple[tuple[Entry, ...], str]:
        """Open the journal if possible. Returns its entries, and why it cannot be written, if so.

        A journal that cannot be opened now is read from a copy, so a full or read-only disk, or
        another process's lock, does not prevent reading.
        """
        try:
            return self.open(), ""
        except JOURNAL_ERRORS as error:
            reason = reason_of(error)
        try:
            return _read_copy(self), reason
        except (*JOURNAL_ERRORS, DamagedError):
            return (), reason

    def open(self) -> tuple[Entry, ...]:
        """Open or create the journal. Returns its entries.

        Raises JOURNAL_ERRORS if that is not possible now. A journal that is damaged, or belongs to
        another run, is set aside and replaced by a new one.
        """
        try:
            return self._open()
        except DamagedError as error:
            self._set_aside(str(error))
            self.set_aside_text += f", and {LOST}"
        return self._open()

    def _open(self) -> tuple[Entry, ...]:
        self.close()
        was_there = self.path.exists()
        size = self.path.stat().st_size if was_there else 0
        written = _frames(self._beside("-wal"))
        try:
            if not os.path.lexists(self.path):
                # Readable only by its owner; SQLite gives the files beside it the same mode.
                with contextlib.suppress(OSError):  # SQLite says why
                    os.close(os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600))
            self._database = database = sqlite3.connect(
                self.path,
                isolation_level=None,
                timeout=BUSY_TIMEOUT_S,
                check_same_thread=False,
            )
            database.text_factory = bytes
            database.execute("PRAGMA synchronous=FULL")
            tables = dict(database.execute("SELECT name, sql FROM sqlite_master"))
            if tables:
                entries = self._read(database, tables)
            # A crash during creation leaves an empty file, or only SQLite's header page.
            elif size not in (0, PAGE_BYTES):
                raise DamagedError("damaged: it has no tables")
            else:
                if was_there:
                    self.set_aside_text = f"{EMPTY}: {LOST}"
                    self._log("error", "journal_empty")
                entries = self._create(database)
            self._check_tail(database, written)
            found = self.path.stat()
            self._file = found.st_dev, found.st_ino
        except JOURNAL_ERRORS as error:
            self.close()
            if isinstance(error, sqlite3.Error) and _code(error) in _DAMAGED:
                raise DamagedError(f"damaged: {error}") from None
            raise
        except DamagedError:
            self.close()
            raise
        except UnicodeDecodeError as error:  # SQLite's message quotes what it has found
            self.close()
            raise DamagedError("damaged: its tables are others") from error
        return entries

    def _create(self, database: sqlite3.Connection) -> tuple[Entry, ...]:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("BEGIN IMMEDIATE")
        for statement in _TABLES.values():
            database.execute(statement)
        meta = self._meta | {"digest": "0"}
        database.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
        database.execute("COMMIT")
        return ()

    def _read(
        self, database: sqlite3.Connection, tables: Mapping[bytes, bytes]
    ) -> tuple[Entry, ...]:
        if tables != {name.encode(): sql.encode() for name, sql in _TABLES.items()}:
            raise DamagedError("damaged: its tables are others")
        ((state,),) = database.execute("PRAGMA quick_check(1)").fetchall()
        if state != b"ok":
            raise DamagedError(f"damaged: {state.decode(errors='replace')}")
        known = dict(database.execute("SELECT key, value FROM meta"))
        digest = known.pop(b"digest", None)
        meta = {key.encode(): value.encode() for key, value in self._meta.items()}
        other = [key.decode() for key, value in meta.items() if known.get(key) != value]
        proofs = database.execute("SELECT * FROM proofs").fetchall()
        rows = database.execute("SELECT * FROM entries ORDER BY author, name").fetchall()
        total = 0
        for row in (*proofs, *rows):
            if row[-1] != _digest(row[:-1]):
                raise DamagedError("damaged: a row is not as it was written")
            total ^= row[-1]
        if digest != str(total).encode():
            raise DamagedError("damaged: rows are missing")
        if other:
            raise DamagedError(f"belongs to another {', '.join(other)}")
        by_batch = {row[:4]: BatchProof(row[4], row[5]) for row in proofs}
        try:
            return tuple(_entry(row, by_batch.get((row[0], *row[2:5]))) for row in rows)
        except ValueError as error:
            raise DamagedError(f"damaged: {error}") from None

    def _check_tail(self, database: sqlite3.Connection, written: int) -> None:
        """Log if SQLite has dropped the end of the write-ahead log, as after a crash during a
        write.
        """
        with contextlib.suppress(sqlite3.Error):  # a disk that is full
            _, found, _ = database.execute("PRAGMA wal_checkpoint").fetchone()
            if 0 <= found < written:
                self._log("warning", "journal_end_dropped", pages=written - found)

    def _set_aside(self, reason: str) -> None:
        """Rename an unusable journal, and keep it for inspection."""
        number = 1
        while (aside := self._beside(f".aside-{number}")).exists():
            number += 1
        for suffix in ("", "-wal", "-shm"):
            with contextlib.suppress(FileNotFoundError):
                self._beside(suffix).rename(aside.with_name(aside.name + suffix))
        self.set_aside_text = f"journal {reason}; it is kept as {aside.name}"
        self._log("error", "journal_set_aside", reason=reason, kept_as=str(aside))

    def _beside(self, suffix: str) -> Path:
        return self.path.with_name(self.path.name + suffix)

    def has_moved(self) -> bool:
        """True if the open file no longer has its name, because it was deleted or replaced."""
        try:
            found = self.path.stat()
        except OSError:
            return True
        return (found.st_dev, found.st_ino) != self._file

    def write(self, changes: Changes) -> None:
        """Write and sync the changes, all or nothing. The journal must be open.

        Raises JOURNAL_ERRORS, and DamagedError if the journal turns out to be damaged.
        """
        database = self._database
        assert database is not None
        try:
            database.execute("BEGIN IMMEDIATE")
            self._write(database, changes)
            database.execute("COMMIT")
        except sqlite3.Error as error:
            with contextlib.suppress(sqlite3.Error):
                if database.in_transaction:
                    database.execute("ROLLBACK")
            if _code(error) in _DAMAGED:
                self.close()
                self._set_aside(f"damaged: {error}")
                raise DamagedError(str(error)) from None
            raise

    def _write(self, database: sqlite3.Connection, changes: Changes) -> None:
        gone: list[int] = []
        rows: list[tuple[Any, ...]] = []
        proofs: dict[tuple[Any, ...], tuple[Any, ...]] = {}
        for key, entry in changes.items():
            of_key = "FROM entries WHERE author = ? AND name = ?"
            gone += _digests(database, of_key, key)
            if entry is None:
                database.execute(f"DELETE {of_key}", key)
                continue
            version = (*entry.version.incarnation, entry.version.sequence)
            rows.append((*key, *version, entry.packed))
            if entry.proof is not None:
                proofs[entry.author, *version] = (entry.proof.hashes, entry.proof.signature)
        for batch in proofs:
            of_batch = "FROM proofs WHERE (author, counter, nonce, sequence) = (?, ?, ?, ?)"
            gone += _digests(database, of_batch, batch)
        made = [(*row, _digest(row)) for row in rows]
        proved = [(*row, _digest(row)) for row in ((*k, *v) for k, v in proofs.items())]
        database.executemany("INSERT OR REPLACE INTO entries VALUES (?, ?, ?, ?, ?, ?, ?)", made)
        database.executemany("INSERT OR REPLACE INTO proofs VALUES (?, ?, ?, ?, ?, ?, ?)", proved)
        self._commits += 1
        if self._commits % COMMITS_PER_CLEANING == 1:
            gone += _digests(database, _UNUSED_PROOFS, ())
            database.execute(f"DELETE {_UNUSED_PROOFS}")
        ((total,),) = database.execute("SELECT value FROM meta WHERE key = 'digest'").fetchall()
        digest = int(total)
        for each in (*gone, *(row[-1] for row in (*made, *proved))):
            digest ^= each
        database.execute("UPDATE meta SET value = ? WHERE key = 'digest'", (str(digest),))

    def close(self) -> None:
        """Close the file. It can be opened again."""
        database, self._database = self._database, None
        if database is not None:
            with contextlib.suppress(sqlite3.Error):
                database.close()


def _digests(database: sqlite3.Connection, where: str, values: tuple[Any, ...]) -> list[int]:
    return [digest for (digest,) in database.execute(f"SELECT digest {where}", values)]


def _digest(columns: Iterable[Any]) -> int:
    """Return the digest of a row of any values, as an integer that SQLite can store."""
    said = repr([each.encode() if isinstance(each, str) else each for each in columns])
    return int.from_bytes(hashlib.blake2b(said.encode(), digest_size=7).digest(), "big")


def _frames(wal: Path) -> int:
    """Return the number of pages, complete or not, in the current generation of the write-ahead
    log.

    Source: https://www.sqlite.org/fileformat.html#the_write_ahead_log
    """
    try:
        data = wal.read_bytes()
    except OSError:
        return 0
    head, frame = 32, 24 + int.from_bytes(data[8:12], "big")
    salts = data[head + 8 : head + 16]
    return sum(
        data[start + 8 : start + 16] == salts for start in range(head, len(data) - 24, frame)
    )


def _entry(row: tuple[Any, ...], proof: BatchProof | None) -> Entry:
    author, name, counter, nonce, sequence, value, _ = row
    version = Version(Incarnation(counter, nonce.decode()), sequence)
    return parse_entry(author.decode(), name.decode(), version, msgpack.unpackb(value), proof)


def journal_path(run_dir: Path, robot: str) -> Path:
    """Return the path of a robot's journal."""
    return run_dir / f"{robot}{SUFFIX}"


def _read_copy(journal: Journal) -> tuple[Entry, ...]:
    """Read a journal without touching it: SQLite would repair and shorten its files.

    Raises JOURNAL_ERRORS, DamagedError.
    """
    with tempfile.TemporaryDirectory(prefix="mrbt-journal-") as folder:
        copy = Path(folder) / journal.path.name
        for suffix in ("", "-wal"):
            with contextlib.suppress(FileNotFoundError):
                shutil.copyfile(
                    journal.path.with_name(journal.path.name + suffix), f"{copy}{suffix}"
                )
        meta = journal._meta
        opened = Journal(copy, meta["mission"], meta["run"], meta["robot"], _ignore)
        try:
            return opened._open()
        finally:
            journal.set_aside_text = opened.set_aside_text
            opened.close()


def read_journals(
    run_dir: Path,
    robots: Iterable[str],
    mission: str,
    run: str,
    on_problem: Callable[[str], None] = lambda _: None,
) -> dict[str, tuple[Entry, ...]]:
    """Return robot -> the entries in its journal; none if it is missing or cannot be used.

    The journals are read from copies, because their robots repair them. `on_problem` is called for
    each that cannot be used, or is missing or empty although its robot has run.
    """
    found: dict[str, tuple[Entry, ...]] = dict.fromkeys(robots, ())
    for robot in found:
        path = journal_path(run_dir, robot)
        try:
            if path.exists():
                copy = Journal(path, mission, run, robot, _ignore)
                found[robot] = _read_copy(copy)
                if copy.set_aside_text:
                    on_problem(f"{path} is empty: {LOST}")
            elif (run_dir / f"{robot}.process").exists():
                on_problem(f"{path} is missing: {LOST}")
        except DamagedError as error:
            on_problem(f"{path} cannot be used: {error}")
        except JOURNAL_ERRORS as error:
            on_problem(f"{path} cannot be used: {reason_of(error)}")
    return found


def _ignore(level: str, event: str, **fields: Any) -> None:
    pass
