"""Notices in the run directory that a team's robots are at other endpoints now.

Robots that are restarted listen on other ports. A program that has watched them before checks the
run directory now and then, and reopens its session.
"""

from __future__ import annotations

from collections.abc import Callable

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.session_config import TransportConfig

LOOK_US = SECOND_US // 2


class TeamChanges:
    """`problem`: why the run directory cannot be read any more; empty if it can."""

    def __init__(
        self, run_dir: RunDir, used: TransportConfig, read: Callable[[RunDir], TransportConfig]
    ) -> None:
        self.problem = ""
        self._run_dir = run_dir
        self._used = used
        self._read = read
        self._next_us = 0

    def look(self, now_us: int) -> TransportConfig | None:
        """Return the team's new transport if it has changed; checks at most every LOOK_US."""
        if now_us < self._next_us:
            return None
        self._next_us = now_us + LOOK_US
        if not self._run_dir.path.is_dir():
            self.problem = f"the run directory {self._run_dir.path} was deleted"
            return None
        try:
            found = self._read(self._run_dir)
        except InputError as error:
            # It may be being written.
            self.problem = str(error)
            return None
        self.problem = ""
        if found == self._used:
            return None
        self._used = found
        return found
