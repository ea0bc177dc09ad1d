"""A disk of one's own, that can be filled and made read-only: a tmpfs, which takes root."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest


@contextlib.contextmanager
def small_disk(path: Path, size: str = "1m") -> Iterator[Path]:
    """A small disk at this place; skips the test where nothing can be mounted."""
    path.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={size},mode=700", "tmpfs", str(path)]
    if os.geteuid() or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("a disk can only be mounted by root")
    try:
        yield path
    finally:
        subprocess.run(["umount", "-l", str(path)], check=False)


def fill(disk: Path) -> None:
    """Fill a disk to its last byte; delete `filler` to make room again."""
    with (disk / "filler").open("ab", buffering=0) as filler, contextlib.suppress(OSError):
        for size in (1 << 16, 1):
            with contextlib.suppress(OSError):
                while True:
                    filler.write(bytes(size))


def make_read_only(disk: Path, is_so: bool = True) -> None:
    """Mount it again, for reading alone or for writing, too."""
    options = f"remount,{'ro' if is_so else 'rw'}"
    subprocess.run(["mount", "-o", options, str(disk)], check=True)
