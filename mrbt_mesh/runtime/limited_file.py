"""Files that grow to a limit: then the file becomes `<name>.1`, in place of an earlier one, and a
new one is begun. A disk that is full costs lines, never the process that writes them.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import io
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mrbt_mesh.runtime.settings import DEFAULT_KEEP_MIB, MIB

DEFAULT_KEEP_BYTES = DEFAULT_KEEP_MIB * MIB
LINE_END = b"\n"


def append(path: Path, line: bytes, limit_bytes: int) -> None:
    """Add a line, with its end, in one write: those of several processes do not mix.

    Raises OSError if the line is not in the file, or not as a whole.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        size = os.fstat(descriptor).st_size
        if size + len(line) > limit_bytes and size and _set_aside(path, descriptor):
            os.close(descriptor)
            descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
            size = 0
        if size and os.pread(descriptor, 1, size - 1) != LINE_END:
            line = LINE_END + line  # the disk was full in the middle of the line before
        if os.write(descriptor, line) < len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    finally:
        os.close(descriptor)


def _set_aside(path: Path, descriptor: int) -> bool:
    """Rename a file that is full, unless another process is doing so at this moment."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(descriptor).st_ino == path.stat().st_ino:
            path.replace(path.with_name(f"{path.name}.1"))
    except OSError:
        return False
    return True


class NewLines:
    """The lines of a file that grows to a limit, for those who follow it. Each is read once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file_number = 0
        self._at = 0

    def take(self) -> Iterator[str]:
        """The lines since the last call, at first those of the file before it too."""
        before = self._path.with_name(f"{self._path.name}.1")
        with contextlib.suppress(OSError):
            if self._path.stat().st_ino != self._file_number:
                if not self._file_number or before.stat().st_ino == self._file_number:
                    yield from self._rest(before)
                self._file_number, self._at = self._path.stat().st_ino, 0
            yield from self._rest(self._path)

    def _rest(self, path: Path) -> Iterator[str]:
        """The whole lines that are not read yet."""
        with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
            file.seek(self._at)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                self._at += len(line)
                yield line[:-1].decode(errors="replace")


class LimitedLog:
    """Where a log writes its lines: a file that fails costs lines.

    `lost` makes a line of their number and the reason once the file can be written again.
    """

    def __init__(self, path: Path, limit_bytes: int, lost: Callable[[int, str], str]) -> None:
        self._path = path
        self._limit_bytes = limit_bytes
        self._lost = lost
        self._count = 0
        self._reason = ""

    def write(self, text: str) -> None:
        try:
            if self._count:
                note = self._lost(self._count, self._reason) + "\n"
                append(self._path, note.encode(), self._limit_bytes)
                self._count = 0
            append(self._path, text.encode(), self._limit_bytes)
        except OSError as error:
            self._count += 1
            self._reason = error.strerror or str(error)

    def flush(self) -> None:
        """Every line is handed to the system as it comes."""


class _Output(io.RawIOBase):
    """Standard output or error that never fails, and is limited where it is the file `path`."""

    def __init__(self, descriptor: int, path: Path | None, limit_bytes: int) -> None:
        self._descriptor = descriptor
        self._path = path
        self._limit_bytes = limit_bytes

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def write(self, data: Any, /) -> int:
        size = memoryview(data).nbytes
        with contextlib.suppress(OSError):
            if self._path is not None:
                _limit_output(self._path, size, self._limit_bytes)
            os.write(self._descriptor, data)
        return size


def _limit_output(path: Path, more_bytes: int, limit_bytes: int) -> None:
    """Begin the file of a robot's output anew if it is full, for all who write to it here."""
    found = os.fstat(1)
    if found.st_size + more_bytes <= limit_bytes or found.st_ino != path.stat().st_ino:
        return
    path.replace(path.with_name(f"{path.name}.1"))
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    for standard in (1, 2):
        os.dup2(descriptor, standard)
    os.close(descriptor)


def protect_output(path: Path | None, limit_bytes: int) -> None:
    """From now on what is printed never fails: what cannot be written is dropped.

    `path`: the file that a robot's standard output and error go to if a launcher started it.
    """
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        raw = _Output(descriptor, path, limit_bytes)
        stream = io.TextIOWrapper(
            io.BufferedWriter(raw), "utf-8", "backslashreplace", line_buffering=True
        )
        setattr(sys, name, stream)
