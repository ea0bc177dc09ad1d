"""The tasks that a server was told are open, on disk: it hears how each has ended, also if that was
while this program did not run, so long ago that the robots keep little of it, or in another run.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import time
from collections.abc import Callable, Container
from pathlib import Path
from typing import Any

from mrbt_mesh.adapters.rmf.messages import OPEN, STATUS
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.private_files import private_opener
from mrbt_mesh.runtime.run_dir import state_dir, write_atomically

_OPEN_STATUSES = frozenset(STATUS[state] for state in OPEN)
# The file is written anew once it has this many lines more than twice those that it needs.
SPARE_LINES = 1_000
# Files of servers that nobody has connected to for so long are removed.
UNUSED_S = 90 * 86_400


class ToldTasks:
    """Id -> the state in which a task was told to be open. A line of the file is such a state, or
    the id of a task that has ended. While there can be no file it is kept in memory alone.
    """

    def __init__(self, about: str, warn: Callable[[str], object]) -> None:
        """`about`: what makes it another server or fleet; of the next run it is the same, whose
        tasks of the same ids are the same ones for the server. `warn` gets a sentence when the file
        cannot be kept, once, and when it was damaged.
        """
        self._warn = warn
        self._has_warned = False
        self._open: dict[str, dict[str, Any]] = {}
        self._lines = 0
        # Whether the file has all that it should have, as far as was written without an error.
        self._is_whole = True
        try:
            folder = state_dir() / "rmf"
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _remove_unused(folder)
        except (InputError, OSError) as error:
            self._path = None
            self._not_kept(error)
            return
        name = hashlib.sha256(about.encode(errors="surrogateescape")).hexdigest()[:32]
        self._path = folder / f"{name}.jsonl"
        try:
            text = self._path.read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            return
        except OSError as error:
            self._not_kept(error)
            return
        damaged = 0
        for line in text.splitlines():
            try:
                self._take(json.loads(line))
            except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
                damaged += 1
        if damaged:
            warn(
                f"{self._path}: {damaged} damaged lines; of the tasks in them the server may not "
                "hear how they ended"
            )
        self._is_whole = False
        self._bring_up_to_date("")

    def will_send(self, state: dict[str, Any]) -> None:
        """A `task_state` is about to be sent: from now on the server may believe a task open."""
        name = state["booking"]["id"]
        if state["status"] in _OPEN_STATUSES and name not in self._open:
            self._note(state)

    def has_sent(self, state: dict[str, Any]) -> None:
        """A `task_state` was sent: if it is an end, the server has been told."""
        name = state["booking"]["id"]
        if state["status"] not in _OPEN_STATUSES and name in self._open:
            self._note(name)

    def not_among(self, known: Container[str]) -> list[dict[str, Any]]:
        """Those of which the rows of jobs say nothing any more."""
        return [state for name, state in self._open.items() if name not in known]

    def _note(self, told: Any) -> None:
        self._take(told)
        self._bring_up_to_date(_line(told))

    def _take(self, told: Any) -> None:
        self._lines += 1
        if isinstance(told, str):
            self._open.pop(told, None)
        elif told["status"] in _OPEN_STATUSES:
            self._open[str(told["booking"]["id"])] = told

    def _bring_up_to_date(self, line: str) -> None:
        """Add a line to the file; write it anew where it lacks more, or has grown too long."""
        if self._path is None:
            return
        try:
            if not self._open:
                self._path.unlink(missing_ok=True)
                self._lines = 0
            elif not self._is_whole or self._lines > 2 * len(self._open) + SPARE_LINES:
                write_atomically(self._path, "".join(map(_line, self._open.values())))
                self._lines = len(self._open)
            else:
                self._is_whole = False
                with open(self._path, "a", encoding="utf-8", opener=private_opener) as file:
                    file.write(line)
            self._is_whole = True
        except (InputError, OSError) as error:
            self._is_whole = False
            self._not_kept(error)

    def _not_kept(self, error: Exception) -> None:
        if not self._has_warned:
            self._has_warned = True
            self._warn(
                "which tasks the server believes open cannot be kept on disk: if this process ends "
                f"now, it may not hear how they ended: {error}"
            )


def _remove_unused(folder: Path) -> None:
    """Of each server that was ever connected to there is a file as long as it has open tasks."""
    oldest_s = time.time() - UNUSED_S
    for path in folder.glob("*.jsonl"):
        with contextlib.suppress(OSError):
            if path.stat().st_mtime < oldest_s:
                path.unlink()


def _line(told: Any) -> str:
    return json.dumps(told, separators=(",", ":")) + "\n"
