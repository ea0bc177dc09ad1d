"""The files of one recording, opened while its writer may go on."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import BinaryIO

from mrbt_mesh.recording.folder import is_finished, number_of_part, open_regular, parts_of


def open_parts(path: Path) -> tuple[list[tuple[Path, BinaryIO]], bool]:
    """Open the parts of the recording whose first part is this file, as they are at one moment.

    Also return whether it is certain that no process wrote them any more then. A later part, or a
    file without parts, is opened alone. Raises OSError.
    """
    while True:
        files = _files_of(path)
        # Tested before they are read, so that what nobody writes any more is read to its end.
        has_ended = is_finished(files[-1])
        with contextlib.ExitStack() as opened:
            found = []
            try:
                for each in files:
                    found.append((each, opened.enter_context(open_regular(each))))
            except FileNotFoundError:
                if _files_of(path) == files:
                    raise
            # Its writer may have begun another part, and removed the first ones.
            if _files_of(path) == files:
                opened.pop_all()
                return found, has_ended


def _files_of(path: Path) -> list[Path]:
    return (parts_of(path) or [path]) if number_of_part(path) == 1 else [path]
