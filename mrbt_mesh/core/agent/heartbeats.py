"""What a robot says of itself in every beat, when it beats, and who hears it.

A small team is told everything. In a larger one beats go to neighbours (`neighbourhood`), and to
everybody what concerns everybody: a robot joins or leaves, has been declared dead or is back, seeks
a lease. Who is about to begin something is told what the others have planned.
"""

from __future__ import annotations

from typing import NamedTuple

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Publish
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.heartbeat import HeartbeatSchedule
from mrbt_mesh.core.membership.wire import Heartbeat, MessageKind, SelfReport, Suspicion
from mrbt_mesh.core.planning.plan import Plan


class Urgent(NamedTuple):
    """What the others must hear at once when it changes."""

    digest: bytes
    result: Status
    accusations: tuple[Suspicion, ...]
    is_joined: bool
    is_leaving: bool
    sought: tuple[str, str] | None
    granted: tuple[tuple[str, str], ...]
    news: int


class Heartbeats:
    """Puts this robot's beats together."""

    def __init__(
        self,
        context: Context,
        schedule: HeartbeatSchedule,
        planner: Planner,
        executor: Executor,
        now_us: int,
    ) -> None:
        self._context = context
        self._schedule = schedule
        self._planner = planner
        self._executor = executor
        self._last: Urgent | None = None
        # Until when beats repeat what everybody is to hear, and what some are.
        self._to_all_until_us = now_us
        self._told_until_us = now_us
        self._told_news = 0
        self._news_from_us = now_us
        self._told: tuple[str, ...] = ()
        self._told_plan: Plan | None = None

    def send_if_due(self, now_us: int) -> None:
        """Beat if it is time, or if there is something that others must hear at once."""
        urgent = self._urgent()
        if self._schedule.is_due(urgent, now_us):
            self._send(urgent, now_us)

    def send_if_regular(self, now_us: int) -> None:
        """Beat if it is time; nothing has changed that others must hear at once."""
        if now_us >= self._schedule.next_due_us:
            self._send(self._urgent(), now_us)

    def send(self, now_us: int) -> None:
        """Beat now."""
        self._send(self._urgent(), now_us)

    def hurry_if_probing(self, now_us: int) -> None:
        """Beat faster while this robot asks for news of another one."""
        membership = self._context.membership
        if membership.is_probing:
            self._schedule.speed_up(membership.live_peer_count, now_us)

    def _urgent(self) -> Urgent:
        context, plan, leases = self._context, self._planner.plan, self._executor.leases
        digest, result = (plan.digest, plan.result) if plan else (b"", Status.RUNNING)
        is_small = context.membership.neighbourhood.is_complete
        if not is_small and context.membership.is_anybody_joining:
            digest = b""  # nobody begins before all have joined, and each changes the plan
        granted = tuple([(grant.coalition, grant.member) for grant in leases.grantor.grants()])
        accusations = context.membership.suspicions()
        is_joined, is_leaving = context.joining is None, context.is_leaving
        return Urgent(
            digest,
            result,
            accusations,
            is_joined,
            is_leaving,
            leases.holder.requested,
            granted,
            context.membership.news_changes,
        )

    def _audience(self, urgent: Urgent, number: int, now_us: int) -> tuple[str, ...] | None:
        """Who hears this beat; None: everybody."""
        context, last, timing = self._context, self._last, self._context.config.timing
        self._last = urgent
        repeats_us = timing.repeat_offsets_us()[-1]
        is_to_all = last is None or _for_all(last) != _for_all(urgent)
        if is_to_all:
            self._to_all_until_us = now_us + repeats_us
        elif urgent == last:  # it is a repetition
            is_to_all = now_us <= self._to_all_until_us
        around, plan = context.membership.neighbourhood, self._planner.plan
        if urgent.digest and (last is None or last.digest != urgent.digest):
            # Who was to begin by the plan before, and has not, is told that it is no more.
            before = self._told_plan
            waiting = starters(before, context.facts) if before is not None else ()
            begins = starters(plan, context.facts) if plan and not around.is_complete else ()
            self._told, self._told_until_us = (*waiting, *begins), now_us + repeats_us
            self._told_plan = plan if begins else None
        awaits_all = plan is not None and (plan.pending_verdicts or plan.pending_losses)
        if urgent.news != self._told_news and now_us >= self._news_from_us:
            # At most once per period: a team that has trouble must not make more of it.
            self._told_news, self._news_from_us = urgent.news, now_us + timing.heartbeat_us
            is_to_all = True
        others = self._told if now_us <= self._told_until_us else ()
        seeking = [grant.member for grant in self._executor.leases.grantor.grants()]
        heard_by = around.audience(number, context.mission.robots, (*others, *seeking))
        return None if is_to_all or urgent.sought is not None or awaits_all else heard_by

    def _send(self, urgent: Urgent, now_us: int) -> None:
        context, plan, executor = self._context, self._planner.plan, self._executor
        self.hurry_if_probing(now_us)
        number = self._schedule.mark_sent(urgent, now_us)
        # A beat renews the leases that this robot holds: it answers itself first.
        granted = executor.leases.heartbeat_sent(number, now_us, executor.may_grant)
        if granted:
            context.write(granted, now_us)
        digest, result = (plan.digest, plan.result) if plan else (bytes(8), Status.RUNNING)
        is_joined, membership = urgent.is_joined, context.membership
        to = self._audience(urgent, number, now_us)
        beat = Heartbeat(
            SelfReport(context.replica.incarnation, number, digest, is_joined, int(result)),
            context.is_leaving,
            context.facts.map.digest(),
            tuple([int(status) for status in executor.tree.statuses]),
            context.work.progress,
            urgent.accusations,
            membership.relays(),
            executor.leases.holder.requested,
            executor.leases.grantor.grants(),
            membership.alive_digest(context.replica.incarnation),
        )
        data = context.config.engine.write_heartbeat(beat, context.replica.header)
        context.emit(Publish(MessageKind.HEARTBEAT, data, to))


def _for_all(urgent: Urgent) -> tuple[object, ...]:
    """What everybody is to hear of."""
    return urgent.is_joined, urgent.is_leaving, urgent.sought


def starters(plan: Plan, facts: TeamFacts) -> tuple[str, ...]:
    """The robots that a plan has begin something: they wait for the others to plan the same."""
    found = []
    for robot, line in plan.lines.items():
        claim = facts.valid_claim(robot)
        runs = claim is not None and claim.phase is Phase.RUNNING
        if claim is None or not runs or claim.activation != line.activation:
            found.append(robot)
    return tuple(sorted(found))
