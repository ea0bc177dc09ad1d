"""Keeps the tasks that a server was told are open, on disk, so that it learns how each has ended.

This works even if a task ended while this program was not running, so long ago that the robots keep
little about it, or in another run.
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
# The file is rewritten once it has this many lines more than twice the number it needs.
SPARE_LINES = 1_000
# Files that have not been written for this long are removed.
UNUSED_S = 90 * 86_400


class ToldTasks:
    """The states in which tasks were reported as open, by id.

    A line of the file is such a state, or the id of a task that has ended. If there can be no file,
    the states are kept in memory only.
    """

    def __init__(self, about: str, warn: Callable[[str], object]) -> None:
        """Read the file of a server and fleet, which `about` identifies.

        `about` is the same in the next run: for the server, tasks with the same ids are the same
        tasks. `warn` is called with a sentence, once if the file cannot be kept, and if it was
        damaged.
        """
        self._warn = warn
        self._has_warned = False
        self._open: dict[str, dict[str, Any]] = {}
        self._lines = 0
        # True if the file is complete: nothing is missing because of an error.
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
        """Note that a `task_state` will be sent: from now on, the server may take it as open."""
        name = state["booking"]["id"]
        if state["status"] in _OPEN_STATUSES and name not in self._open:
            self._note(state)

    def has_sent(self, state: dict[str, Any]) -> None:
        """Note that a `task_state` was sent: if the task has ended, the server knows it now."""
        name = state["booking"]["id"]
        if state["status"] not in _OPEN_STATUSES and name in self._open:
            self._note(name)

    def not_among(self, known: Container[str]) -> list[dict[str, Any]]:
        """Return the states of open tasks that are not in `known`."""
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
        """Append a line to the file; rewrite the file if it is incomplete or too long."""
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
    """Remove old files: each server has one as long as it has open tasks."""
    oldest_s = time.time() - UNUSED_S
    for path in folder.glob("*.jsonl"):
        with contextlib.suppress(OSError):
            if path.stat().st_mtime < oldest_s:
                path.unlink()


def _line(told: Any) -> str:
    return json.dumps(told, separators=(",", ":")) + "\n"
