"""A robot's description of itself: its member entry, with losses and present performances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.facts.records import MAX_CAPABILITIES, Member
from mrbt_mesh.core.facts.values import MAX_TEXT
from mrbt_mesh.core.mission.failure_reasons import one_line
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO, performance
from mrbt_mesh.core.mission.names import ALL, type_name

# The sources of losses. A source cannot take back another one's loss, except that the operator can
# take back the program's, unless the program itself watches for the end.
PROGRAM, OPERATOR = "program", "operator"


@dataclass(frozen=True, slots=True)
class _Loss:
    reason: str
    is_pending: bool
    is_watched: bool = False


class Description:
    """A robot's own description.

    `lost`: types or ground local tasks, sorted -> why they are lost. `pending`: the same for those
    that cannot be used yet. `watched`: those in `lost` that no operator can take back. The
    capabilities are initially those that the robot was started with, and only their values change.
    `may_promise` is as in `Member`.
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
        self.may_promise = True
        # By local task and source.
        self._losses: dict[tuple[str, str], _Loss] = {}

    def use(self, kind: str, capabilities: Mapping[str, int]) -> None:
        """Apply a mission revision. Lost capabilities stay lost. A performance that the robot
        reported is kept if its declared value has not changed.
        """
        kept = {
            name: value
            for name, value in self._capabilities.items()
            if name in capabilities and self._declared.get(name) == capabilities[name]
        }
        self._type, self._declared = kind, capabilities
        self._capabilities = {**capabilities, **kept}
        known = {type_name(name) for name in capabilities}
        self._losses = {
            (name, source): loss
            for (name, source), loss in self._losses.items()
            if type_name(name) in known
        }

    def resume(self, known: Member) -> None:
        """Take over the robot's earlier description."""
        self._capabilities = dict(known.capabilities)
        lost = {(name, PROGRAM): _Loss(reason, False) for name, reason in known.lost.items()}
        pending = {(name, PROGRAM): _Loss(reason, True) for name, reason in known.pending.items()}
        self._losses = pending | lost

    @property
    def lost(self) -> Mapping[str, str]:
        return self._reasons(is_pending=False)

    @property
    def pending(self) -> Mapping[str, str]:
        lost = self.lost
        found = self._reasons(is_pending=True)
        return {name: reason for name, reason in found.items() if name not in lost}

    @property
    def watched(self) -> tuple[str, ...]:
        losses = self._losses.items()
        names = {n for (n, source), loss in losses if self._is_watched(source, loss)}
        return tuple(sorted(names & self.lost.keys()))

    def _is_watched(self, source: str, loss: _Loss) -> bool:
        return loss.is_watched or source not in (PROGRAM, OPERATOR)

    def _reasons(self, is_pending: bool) -> dict[str, str]:
        """Return what is lost, or pending, each with all of its reasons in one line."""
        found: dict[str, list[str]] = {}
        for (name, _), loss in sorted(self._losses.items()):
            if loss.is_pending is is_pending:
                found.setdefault(name, []).append(loss.reason)
        return {name: one_line("; ".join(filter(None, all_))) for name, all_ in found.items()}

    def lose(
        self,
        local_task: str,
        reason: str = "",
        source: str = OPERATOR,
        is_pending: bool = False,
        is_watched: bool = False,
    ) -> str | None:
        """Report a minor fault, or a capability that cannot be used yet; `all` means every one.

        `is_watched`: the source notices its end itself, so no operator can take it back. Returns an
        error text, or None.
        """
        problem = self._problem(local_task)
        if problem is None:
            names = set(self._capabilities) if local_task == ALL else {local_task}
            known = {name for name, _ in self._losses}
            if len(known | names) > MAX_CAPABILITIES or len(local_task) > MAX_TEXT:
                return f"{self._robot} cannot lose more than {MAX_CAPABILITIES} local tasks"
            loss = _Loss(one_line(reason), is_pending, is_watched)
            self._losses |= {(name, source): loss for name in sorted(names)}
        return problem

    def restore(self, local_task: str, source: str = OPERATOR) -> str | None:
        """End a loss reported by `source`. The operator also ends the program's losses.

        The operator cannot end a loss that the program watches. A type includes its ground local
        tasks. Returns an error text, or None.
        """
        problem = self._problem(local_task)
        if problem is None:
            ended = {
                (name, said_by)
                for (name, said_by), loss in self._losses.items()
                if said_by == source
                or (source == OPERATOR and said_by == PROGRAM and not loss.is_watched)
                if local_task in (ALL, name, type_name(name))
            }
            self._losses = {key: loss for key, loss in self._losses.items() if key not in ended}
        return problem

    def perform(self, local_task: str, value: int, source: str = OPERATOR) -> str | None:
        """Set the performance to `value`, in micro-units; 0 means that the capability is lost.

        A type includes all of its ground local tasks. A loss under this name ends. Returns an error
        text, or None.
        """
        if not 0 <= value <= MAX_PERFORMANCE:
            most = MAX_PERFORMANCE // MICRO
            return f"a performance is a number from 0 to {most}, not {value / MICRO:g}"
        if value == 0:
            return self.lose(local_task, "its performance is 0", source)
        # A type's value replaces the values of its single ground local tasks.
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
        self.restore(local_task, source)
        return None

    def performance(self, local_task: str) -> int | None:
        """The present performance in micro-units, even if it is lost; None if it never had one."""
        return performance(self._capabilities, local_task)

    def changes(self) -> dict[str, Any]:
        """What differs from the declared description, with reasons; performances in units."""
        declared = self._declared
        values = {n: v / MICRO for n, v in self._capabilities.items() if declared.get(n) != v}
        more = {"pending": self.pending, "performances": values}
        return {"lost": dict(self.lost), **{key: value for key, value in more.items() if value}}

    def _problem(self, local_task: str) -> str | None:
        known = {type_name(name) for name in self._capabilities}
        if local_task == ALL or type_name(local_task) in known:
            return None
        return self._unknown(local_task)

    def _unknown(self, local_task: str) -> str:
        listed = ", ".join(sorted(self._declared))
        return f"{self._robot} has no local task {local_task!r}; it has {listed}"

    def member(self, is_leaving: bool) -> Member:
        """The record of the robot's member entry."""
        return Member(
            self._type,
            self._capabilities,
            self.lost,
            is_leaving,
            self._software,
            self._host,
            self._pid,
            self.may_promise,
            self.pending,
            self.watched,
        )
