"""A coalition counts only if all its members begin within a bound.

A robot that begins notes the time on its own clock and waits to hear that the others have begun, by
their claims or their outcomes. Until then it withholds its success, but no longer than a message
takes: no member may begin after another has ended. Once the bound has passed it drops out, so that
the coalition is broken and a new one is formed. Clocks are not compared: each member uses its own.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished
from mrbt_mesh.core.facts.records import CLAIM, Claim, Phase
from mrbt_mesh.core.feature import Kit, Part
from mrbt_mesh.features.exclusive.coalitions import coalitions_of
from mrbt_mesh.features.exclusive.fields import policy_of
from mrbt_mesh.features.exclusive.records import CoalitionId, CoalitionMember


@dataclass(slots=True)
class _Begun:
    """What this robot has begun in a coalition. `success`: its success, if it is being withheld."""

    action: StartAction
    ends_us: int
    success: ActionFinished | None = None


class BeginWatch(Part):
    """Waits until all members of this robot's coalition have begun."""

    def __init__(self, kit: Kit) -> None:
        self._context = kit.context
        self._report = kit.report
        self._given_up = kit.given_up
        self._begun: _Begun | None = None

    def next_us(self, now_us: int) -> int | None:
        """When the bound passes; None if nothing is awaited."""
        return self._begun.ends_us if self._begun is not None else None

    def finished(self, event: ActionFinished, now_us: int) -> bool:
        """Whether the success of an action has to wait."""
        begun, is_stopping = self._begun, self._context.work.is_stopping
        if begun is None or begun.action.ticket != event.ticket or is_stopping:
            return False
        if not event.success or self._have_all_begun(begun.action):
            self._begun = None
            return False
        # Beginnings not heard by now are on their way, or come after this action has ended.
        begun.success = event
        begun.ends_us = min(begun.ends_us, now_us + self._context.config.timing.grace_us)
        return True

    def started(self, action: StartAction, now_us: int) -> None:
        policy = policy_of(self._context.facts.task_of(action.activation))
        self._begun = None
        if policy is not None and policy.simultaneous and action.party:
            within_us = policy.begin_within_us or self._context.config.timing.detection_us
            self._begun = _Begun(action, now_us + within_us)

    def follow(self, now_us: int) -> None:
        """Check before a step whether all others have begun, or the bound has passed."""
        begun, work = self._begun, self._context.work
        if begun is None:
            return
        claim = work.claim
        if work.is_stopping or claim is None or claim.party != begun.action.party:
            self._begun = None
            if begun.success is not None:
                work.stopped(begun.action.ticket)  # the program has already ended
        elif self._have_all_begun(begun.action):
            self._begun = None
            if begun.success is not None:
                self._report(begun.success, now_us)
        elif now_us >= begun.ends_us:
            self._begun = None
            self._drop_out(begun, claim, now_us)

    def _drop_out(self, begun: _Begun, claim: Claim, now_us: int) -> None:
        context, action = self._context, begun.action
        missing = [m.robot for m in self._members(action) if not self._has_begun(m, action)]
        context.log("warning", "partners_too_late", **action.called, partners=missing)
        writes = self._given_up(claim)
        if begun.success is not None:
            context.work.stopped(action.ticket)
        context.emit(*context.work.drop())
        context.write([*writes, context.claim()], now_us)

    def _have_all_begun(self, action: StartAction) -> bool:
        return all(self._has_begun(member, action) for member in self._members(action))

    def _members(self, action: StartAction) -> tuple[CoalitionMember, ...]:
        found = coalitions_of(self._context.facts, action.activation)
        return found.members.get(CoalitionId.parse(action.party), ())

    def _has_begun(self, member: CoalitionMember, action: StartAction) -> bool:
        facts, token = self._context.facts, CoalitionId.parse(action.party)
        if member.robot == self._context.me:
            return True
        if coalitions_of(facts, action.activation).outcome(token, member) is not None:
            return True
        entry = facts.map.get(member.robot, CLAIM)
        claim = entry.record if entry is not None else None
        if not isinstance(claim, Claim) or claim.phase is not Phase.RUNNING:
            return False
        return (claim.activation, claim.party) == (action.activation, action.party)
