"""What a robot says of itself: its member entry, with the capabilities that it has lost."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.facts.records import MAX_CAPABILITIES, MAX_TEXT, Member
from mrbt_mesh.core.mission.mission import type_name

ALL = "all"


class Description:
    """A robot's own description. `lost` are types or ground local tasks, sorted."""

    def __init__(
        self,
        robot: str,
        kind: str,
        capabilities: Mapping[str, int],
        software: str,
        host: str,
        pid: int,
    ) -> None:
        self._robot = robot
        self._type = kind
        self._capabilities = dict(capabilities)
        self._software = software
        self._host = host
        self._pid = pid
        self.lost: tuple[str, ...] = ()

    def lose(self, local_task: str) -> str | None:
        """A minor fault; `all` loses everything. Returns what is wrong with it, or None."""
        problem = self._problem(local_task)
        if problem is None:
            names = self._capabilities if local_task == ALL else (local_task,)
            lost = {*self.lost, *names}
            if len(lost) > MAX_CAPABILITIES or len(local_task) > MAX_TEXT:
                return f"{self._robot} cannot lose more than {MAX_CAPABILITIES} local tasks"
            self.lost = tuple(sorted(lost))
        return problem

    def restore(self, local_task: str) -> str | None:
        """The end of a minor fault; a type restores its ground local tasks too."""
        problem = self._problem(local_task)
        if problem is None:
            self.lost = tuple(
                name
                for name in self.lost
                if local_task not in (ALL, name) and type_name(name) != local_task
            )
        return problem

    def _problem(self, local_task: str) -> str | None:
        known = {type_name(name) for name in self._capabilities}
        if local_task == ALL or type_name(local_task) in known:
            return None
        listed = ", ".join(sorted(self._capabilities))
        return f"{self._robot} has no local task {local_task!r}; it has {listed}"

    def to_value(self, is_leaving: bool) -> list[Any]:
        """The member entry's value."""
        return Member(
            self._type,
            self._capabilities,
            self.lost,
            is_leaving,
            self._software,
            self._host,
            self._pid,
        ).to_value()
