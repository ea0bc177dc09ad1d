"""A coalition counts only if all its members begin within a bound.

A robot that begins notes the time on its own clock and waits to hear that the others have begun, by
their claims or their outcomes. Until then it withholds its success, but no longer than a message
takes: no member may begin after another has ended. Once the bound has passed it drops out, so that
the coalition is broken and a new one is formed. Clocks are not compared: each member uses its own.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.inputs import ActionFinished
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.facts.records import CLAIM, Claim, CoalitionId, CoalitionMember, Phase


@dataclass(slots=True)
class _Begun:
    """What this robot has begun in a coalition. `success`: its success, if it is being withheld."""

    action: StartAction
    ends_us: int
    success: ActionFinished | None = None


class BeginWatch:
    """Waits until all members of this robot's coalition have begun."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._begun: _Begun | None = None

    def use(self, executor: Executor, reports: Reports) -> None:
        """Use the parts that were composed for the mission in force."""
        self._executor = executor
        self._reports = reports
        executor.on_start = self._started

    @property
    def next_us(self) -> int | None:
        """When the bound passes; None if nothing is awaited."""
        return self._begun.ends_us if self._begun is not None else None

    def finished(self, event: ActionFinished, now_us: int) -> None:
        """Process the end of an action. Its success may have to wait."""
        begun, is_stopping = self._begun, self._context.work.is_stopping
        if begun is None or begun.action.ticket != event.ticket or is_stopping:
            self._reports.finished(event, now_us)
        elif not event.success or self._have_all_begun(begun.action):
            self._begun = None
            self._reports.finished(event, now_us)
        else:
            # Beginnings not heard by now are on their way, or come after this action has ended.
            begun.success = event
            begun.ends_us = min(begun.ends_us, now_us + self._context.config.timing.grace_us)

    def _started(self, action: StartAction, now_us: int) -> None:
        task = self._context.facts.task_of(action.activation)
        self._begun = None
        if task is not None and task.simultaneous and action.coalition:
            within_us = task.begin_within_us or self._context.config.timing.detection_us
            self._begun = _Begun(action, now_us + within_us)

    def check(self, now_us: int) -> None:
        """Check before a step whether all others have begun, or the bound has passed."""
        begun, work = self._begun, self._context.work
        if begun is None:
            return
        claim = work.claim
        if work.is_stopping or claim is None or claim.coalition != begun.action.coalition:
            self._begun = None
            if begun.success is not None:
                work.stopped(begun.action.ticket)  # the program has already ended
        elif self._have_all_begun(begun.action):
            self._begun = None
            if begun.success is not None:
                self._reports.finished(begun.success, now_us)
        elif now_us >= begun.ends_us:
            self._begun = None
            self._drop_out(begun, claim, now_us)

    def _drop_out(self, begun: _Begun, claim: Claim, now_us: int) -> None:
        context, action = self._context, begun.action
        missing = [m.robot for m in self._members(action) if not self._has_begun(m, action)]
        context.log("warning", "partners_too_late", **action.called, partners=missing)
        writes = self._executor.given_up(claim)
        if begun.success is not None:
            context.work.stopped(action.ticket)
        context.emit(*context.work.drop())
        context.write([*writes, context.claim()], now_us)

    def _have_all_begun(self, action: StartAction) -> bool:
        return all(self._has_begun(member, action) for member in self._members(action))

    def _members(self, action: StartAction) -> tuple[CoalitionMember, ...]:
        found = self._context.facts.coalitions(action.activation)
        return found.members.get(CoalitionId.parse(action.coalition), ())

    def _has_begun(self, member: CoalitionMember, action: StartAction) -> bool:
        facts, token = self._context.facts, CoalitionId.parse(action.coalition)
        if member.robot == self._context.me:
            return True
        if facts.coalitions(action.activation).outcome(token, member) is not None:
            return True
        entry = facts.map.get(member.robot, CLAIM)
        claim = entry.record if entry is not None else None
        if not isinstance(claim, Claim) or claim.phase is not Phase.RUNNING:
            return False
        return (claim.activation, claim.coalition) == (action.activation, action.coalition)
