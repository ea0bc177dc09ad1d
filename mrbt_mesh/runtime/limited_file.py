"""Files with a size limit: a full file becomes `<name>.1`, replacing an earlier one, and a new one
begins.

A full disk costs lines, never the process that writes them.
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
    """Append a line, with its end, in one write, so that lines of several processes do not mix.

    Raises OSError if the line is not, or not completely, in the file.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        size = os.fstat(descriptor).st_size
        if size + len(line) > limit_bytes and size and _set_aside(path, descriptor):
            os.close(descriptor)
            descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
            size = 0
        if size and os.pread(descriptor, 1, size - 1) != LINE_END:
            line = LINE_END + line  # the disk was full in the middle of the previous line
        if os.write(descriptor, line) < len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    finally:
        os.close(descriptor)


def _set_aside(path: Path, descriptor: int) -> bool:
    """Rename a full file, unless another process is doing so at this moment."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(descriptor).st_ino == path.stat().st_ino:
            path.replace(path.with_name(f"{path.name}.1"))
    except OSError:
        return False
    return True


class NewLines:
    """Follows a file with a size limit; returns each line once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file_number = 0
        self._at = 0

    def take(self) -> Iterator[str]:
        """Yield the lines since the last call.

        The first call includes those of the previous file.
        """
        before = self._path.with_name(f"{self._path.name}.1")
        with contextlib.suppress(OSError):
            if self._path.stat().st_ino != self._file_number:
                if not self._file_number or before.stat().st_ino == self._file_number:
                    yield from self._rest(before)
                self._file_number, self._at = self._path.stat().st_ino, 0
            yield from self._rest(self._path)

    def _rest(self, path: Path) -> Iterator[str]:
        """Yield the complete lines that were not read yet."""
        with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
            file.seek(self._at)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                self._at += len(line)
                yield line[:-1].decode(errors="replace")


class LimitedLog:
    """A log file with a size limit. Lines that cannot be written are dropped.

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
        """Do nothing: every line is passed to the system at once."""


class _Output(io.RawIOBase):
    """Standard output or error that never fails, limited in size if it is the file `path`."""

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
    """Start the file of a robot's output anew if it is full, for standard output and error."""
    found = os.fstat(1)
    if found.st_size + more_bytes <= limit_bytes or found.st_ino != path.stat().st_ino:
        return
    path.replace(path.with_name(f"{path.name}.1"))
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    for standard in (1, 2):
        os.dup2(descriptor, standard)
    os.close(descriptor)


def protect_output(path: Path | None, limit_bytes: int) -> None:
    """Make printing never fail from now on: what cannot be written is dropped.

    `path`: the file to which a robot's standard output and error go if a launcher started it.
    """
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        raw = _Output(descriptor, path, limit_bytes)
        stream = io.TextIOWrapper(
            io.BufferedWriter(raw), "utf-8", "backslashreplace", line_buffering=True
        )
        setattr(sys, name, stream)
