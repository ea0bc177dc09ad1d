"""A robot's description of itself: its member entry, with its losses and present performances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.facts.records import MAX_CAPABILITIES, Member
from mrbt_mesh.core.facts.values import MAX_TEXT
from mrbt_mesh.core.mission.failure_reasons import one_line
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO, performance
from mrbt_mesh.core.mission.names import ALL, type_name

# The sources of losses. One does not take back a loss by another, except that the operator takes
# back the program's too, if the program does not notice the end itself.
PROGRAM, OPERATOR = "program", "operator"


@dataclass(frozen=True, slots=True)
class _Loss:
    reason: str
    is_pending: bool
    is_watched: bool = False


class Description:
    """A robot's own description.

    `lost`: types or ground local tasks, sorted -> why they are lost; `pending`: the same for those
    that cannot be used yet; `watched`: those in `lost` that no operator can take back. Its
    capabilities are at first those that it was started with, and change in value only.
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
        """What a revision of the mission says of it. What it has lost stays lost, and performances
        that it has changed itself stay where the declared one is as before.
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
        """Take over what the robot has said of itself before."""
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
        """Of what is lost, or pending, all reasons in one line."""
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
        """A minor fault, or what cannot be used yet; `all` loses everything.

        `is_watched`: its end is noticed by the source, so no operator can take it back.
        Returns what is wrong with it, or None.
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
        """The end of what `source` has said; of the operator, of what the program has said too.

        A type restores its ground local tasks too. Returns what is wrong with it, or None.
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
        """From now on `value` is the performance, in micro-units; 0: the capability is lost.

        A type means all its ground local tasks. A loss under this name ends.
        Returns what is wrong with it, or None.
        """
        if not 0 <= value <= MAX_PERFORMANCE:
            most = MAX_PERFORMANCE // MICRO
            return f"a performance is a number from 0 to {most}, not {value / MICRO:g}"
        if value == 0:
            return self.lose(local_task, "its performance is 0", source)
        # Values of single ground local tasks end with a value of their type.
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
        """How well it does it now, in micro-units, lost or not; None: it never could."""
        return performance(self._capabilities, local_task)

    def changes(self) -> dict[str, Any]:
        """What is not as it was at first, with the reasons; performances in units."""
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
