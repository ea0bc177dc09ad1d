"""Checks folders whose content is trusted: only their owner may write there.

Whoever can write to a run directory or a folder of keys can tell robots anything, and can plant
links to files that are then overwritten. So both are checked in the way that ssh checks its files.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import IO, Any

from mrbt_mesh.errors import InputError

WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH
READABLE_BY_OTHERS = stat.S_IRGRP | stat.S_IROTH


def check_folder(path: Path, what: str) -> None:
    """Raise InputError if an existing folder is a link, belongs to another user, or is writable by
    others.
    """
    try:
        found = path.lstat()
    except OSError:
        return
    if stat.S_ISLNK(found.st_mode):
        raise InputError(f"{what} {path} is a link: name the folder itself")
    if found.st_uid not in (0, os.geteuid()):
        raise InputError(
            f"{what} {path} belongs to another user (uid {found.st_uid}), who could make robots do "
            "anything: use a folder of your own"
        )
    if found.st_mode & WRITABLE_BY_OTHERS:
        raise InputError(
            f"{what} {path} can be written by other users: `chmod go-w {path}`, or use another one"
        )


def open_to_others(file: IO[Any]) -> str:
    """Return what other users can do with an open file, in words; empty if it is private.

    The owner of another user's file, such as a mounted secret, decides who may read it.
    """
    found = os.fstat(file.fileno())
    if found.st_mode & WRITABLE_BY_OTHERS:
        return "can be written by other users"
    is_own = found.st_uid == os.geteuid()
    return "can be read by other users" if is_own and found.st_mode & READABLE_BY_OTHERS else ""


def private_opener(path: str, flags: int) -> int:
    """Opener for `open(..., opener=)`: new files are private to their owner, and links are not
    followed.
    """
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
