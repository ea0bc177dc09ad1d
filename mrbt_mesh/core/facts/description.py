"""What a robot says of itself: its member entry, with what it has lost and how well it does now."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.facts.records import MAX_CAPABILITIES, Member
from mrbt_mesh.core.facts.values import MAX_TEXT
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO, performance
from mrbt_mesh.core.mission.names import type_name

ALL = "all"


class Description:
    """A robot's own description. `lost` are types or ground local tasks, sorted.

    `may_promise` is as in `Member`.

    Its capabilities are at first those that it was started with, and change in value only.
    """

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
        self._declared = capabilities
        self._capabilities = dict(capabilities)
        self._software = software
        self._host = host
        self._pid = pid
        self.lost: tuple[str, ...] = ()
        self.may_promise = True

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

    def perform(self, local_task: str, value: int) -> str | None:
        """From now on `value` is the performance, in micro-units; 0: the capability is lost.

        A type stands for all its ground local tasks. What was lost under this name is had again.
        Returns what is wrong with it, or None.
        """
        if not 0 <= value <= MAX_PERFORMANCE:
            most = MAX_PERFORMANCE // MICRO
            return f"a performance is a number from 0 to {most}, not {value / MICRO:g}"
        if value == 0:
            return self.lose(local_task)
        # What was told of single ground local tasks ends with what is told of their type.
        kept = {
            name: known
            for name, known in self._capabilities.items()
            if name in self._declared or type_name(name) != local_task
        }
        named = [name for name in kept if local_task in (name, type_name(name))]
        if not named and performance(self._declared, local_task) is None:
            return self._unknown(local_task)
        kind = type_name(local_task)
        if kind != local_task and kind in self.lost:
            return f"{self._robot} has lost {kind} altogether"
        if len(kept) >= MAX_CAPABILITIES or len(local_task) > MAX_TEXT:
            return f"{self._robot} cannot tell more than {MAX_CAPABILITIES} performances"
        self._capabilities = kept | dict.fromkeys(named or [local_task], value)
        self.restore(local_task)
        return None

    def performance(self, local_task: str) -> int | None:
        """How well it does it now, in micro-units, lost or not; None: it never could."""
        return performance(self._capabilities, local_task)

    def changes(self) -> dict[str, Any]:
        """What is not as it was at first: `lost`, and performances in units."""
        declared = self._declared
        values = {n: v / MICRO for n, v in self._capabilities.items() if declared.get(n) != v}
        return {"lost": list(self.lost), **({"performances": values} if values else {})}

    def _problem(self, local_task: str) -> str | None:
        known = {type_name(name) for name in self._capabilities}
        if local_task == ALL or type_name(local_task) in known:
            return None
        return self._unknown(local_task)

    def _unknown(self, local_task: str) -> str:
        listed = ", ".join(sorted(self._declared))
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
            self.may_promise,
        ).to_value()
