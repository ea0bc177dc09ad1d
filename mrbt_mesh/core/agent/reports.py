"""The facts about a robot's work: outcomes and conditions, and its leave."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.inputs import ActionFinished, CapabilityChanged
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import ConditionValue, Outcome
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.membership.timing import HeartbeatSchedule
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.failure_reasons import one_line
from mrbt_mesh.core.mission.names import split_owner
from mrbt_mesh.core.planning.outcome_tick import facts_of_tick


class Reports:
    """Writes facts about the robot's work for the team."""

    def __init__(
        self,
        context: Context,
        executor: Executor,
        schedule: HeartbeatSchedule,
        health: Health,
    ) -> None:
        self._context = context
        self._executor = executor
        self._schedule = schedule
        self._health = health
        # Conditions kept back until a new incarnation, above all earlier ones, has joined.
        self._unsaid: dict[str, Value | None] = {}

    def finished(self, event: ActionFinished, now_us: int) -> None:
        """Write the outcome, its conditions, the latched results of its tick of T_G and the end of
        the claim, as one batch.
        """
        context, work = self._context, self._context.work
        claimed, action = work.claim, work.action
        if action is not None and action.travel_to and action.ticket == event.ticket:
            if self._way_ended(action, event, now_us):
                return
            event = replace(event, reason=_unreachable(action, event))
        action = work.finish(event.ticket, event.success)
        if action is None:
            return
        if not action.global_task:
            context.log("info", "returned", success=event.success, error=event.error)
            return
        name = f"{records.OUTCOME}/{action.activation}/{action.local_task}"
        if action.party:
            name += f"/{action.party}"
        reason = "" if event.success else one_line(event.reason)
        facts: list[Fact] = [(name, Outcome(event.success, None, reason))]
        names = {"global_task": action.global_task, "local_task": action.local_task}
        if action.values:
            names = action.called
        ends = context.mission.conditions_after_end(**names, success=event.success, reason=reason)
        job = parse_activation(action.activation).job
        conditions = self._changed_conditions([*event.conditions, *ends], job)
        if conditions and context.facts.task_of(action.activation) is not None:
            version = context.replica.next_version
            status = context.facts.status_after(name, context.me, event.success, version)
            values = {condition: record.value for condition, record in conditions.items()}
            facts += facts_of_tick(context.facts, context.me, action.activation, status, values)
        facts += _condition_facts(conditions)
        if work.claim is None and claimed is not None:
            facts.append(context.claim())
        context.write(facts, now_us)
        level, outcome = ("info", "success") if event.success else ("warning", "failure")
        context.log(level, "local_task_finished", **names, outcome=outcome, error=event.error)

    def _way_ended(self, action: StartAction, event: ActionFinished, now_us: int) -> bool:
        """Process the end of a way: the place was reached or not. Returns True if no outcome
        follows.

        If it was not reached, and robots do the task jointly, the robot loses the capability: no
        outcome is possible before they have begun.
        """
        context, work = self._context, self._context.work
        names = {"local_task": action.local_task, "place": action.travel_to}
        if event.success:
            work.arrive(action, now_us)
            context.log("info", "arrived", **names)
            return True
        context.log("warning", "place_not_reached", **names, error=event.error or event.reason)
        if work.is_stopping:
            work.stopped(action.ticket)
            return True
        task = context.facts.task_of(action.activation)
        if task is None or task.joint is None:
            return False
        work.finish(action.ticket, success=False)
        context.write([context.claim()], now_us)
        reason = _unreachable(action, event)
        self._health.change_capability(CapabilityChanged(action.local_task, True, reason), now_us)
        return True

    # -- conditions ---------------------------------------------------------------------------

    def set_conditions(
        self, values: Mapping[str, Value | None], now_us: int, job: str = ""
    ) -> None:
        """Write conditions, set in a task of `job`. They are kept back until a new incarnation,
        above all earlier ones, has joined.
        """
        if self._context.is_new:
            mission = self._context.mission
            known = {n: v for n, v in values.items() if mission.entries.knows(split_owner(n)[0])}
            self._unsaid |= known
            values = {n: v for n, v in values.items() if n not in known}
        changed = self._changed_conditions(values.items(), job)
        if changed:
            self._context.write(_condition_facts(changed), now_us)

    def joined(self, now_us: int) -> None:
        """Write the conditions that were set before the robot joined."""
        unsaid, self._unsaid = self._unsaid, {}
        self.set_conditions(unsaid, now_us)

    def _changed_conditions(
        self, conditions: Iterable[tuple[str, Value | None]], job: str = ""
    ) -> dict[str, ConditionValue]:
        """The records of the conditions whose values differ from the present ones."""
        context, facts = self._context, self._context.facts
        changed: dict[str, ConditionValue] = {}
        stamp = facts.max_stamp + 1
        for given, value in conditions:
            name = context.mission.entries.of(context.me, given, job)
            changes = facts.conditions.changes(name)
            if not context.mission.entries.can_be_set(name):
                context.log("error", "condition_not_declared", condition=name)
            elif facts.conditions.entry(name) != value:
                changed[name] = ConditionValue(value, changes + 1, stamp)
            elif changes and name != given and context.last_word(name) != value:
                # Other robots wrote this about this robot, which no longer contradicts them.
                changed[name] = ConditionValue(value, changes, stamp)
            else:
                changed.pop(name, None)
        return changed

    # -- leaving ------------------------------------------------------------------------------

    def leave(self, now_us: int) -> None:
        """Hand the work over, and leave."""
        context = self._context
        if context.is_leaving:
            return
        context.is_leaving = True
        context.log("info", "leaving")
        claim = context.work.claim
        writes = self._executor.given_up(claim) if claim is not None else []
        context.emit(*context.work.drop())
        if context.has_place:
            context.write([*writes, context.member(), context.claim()], now_us)
        self._schedule.make_due(now_us)


def _unreachable(action: StartAction, event: ActionFinished) -> str:
    """Why a robot that could not reach a place has failed."""
    return f"cannot reach {action.travel_to}" + (f": {event.reason}" if event.reason else "")


def _condition_facts(changed: Mapping[str, ConditionValue]) -> list[Fact]:
    return [(f"{records.CONDITION}/{name}", value) for name, value in changed.items()]
