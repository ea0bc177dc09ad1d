"""What a robot says of itself in every beat, when it beats, and who hears it.

A small team is told everything. In a larger one beats go to neighbours (`neighbourhood`), and to
everybody what concerns everybody: a robot starts or leaves, has been declared dead or is back,
seeks a lease. That it has joined everybody hears by its facts. What robots plan goes to those who
wait for it, by way of speakers (`plan_news`).
"""

from __future__ import annotations

from typing import NamedTuple

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Publish
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.plan_news import PlanNews
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.membership.heartbeat import HeartbeatSchedule
from mrbt_mesh.core.membership.wire import Heartbeat, MessageKind, SelfReport, Suspicion


class Urgent(NamedTuple):
    """What the others must hear at once when it changes.

    `is_agreed`: this robot speaks for its section, all of which report its plan.
    """

    digest: bytes
    result: Status
    accusations: tuple[Suspicion, ...]
    is_joined: bool
    is_leaving: bool
    sought: tuple[str, str] | None
    granted: tuple[tuple[str, str], ...]
    news: int
    is_agreed: bool


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
        self._plan_news = PlanNews(context, planner, now_us)
        self._told_news = 0
        # Only plans have changed last; neighbours have heard no beat since, which would show them
        # that they lack a fact; until when beats repeat what they are to hear.
        self._only_plans = self._is_owed = False
        self._news_until_us = now_us
        self._news_from_us = now_us

    def send_if_due(self, now_us: int) -> None:
        """Beat if it is time, or if there is something that others must hear at once."""
        urgent = self._urgent()
        if self._schedule.is_due(urgent, now_us):
            self._send(urgent, now_us)

    def send_if_regular(self, now_us: int) -> None:
        """Beat if it is time; of what others must hear at once only reports may have changed."""
        last, is_due = self._last, now_us >= self._schedule.next_due_us
        if is_due or (last and self._plan_news.agrees(last.digest) != last.is_agreed):
            self._send(self._urgent(), now_us)

    def send(self, now_us: int) -> None:
        """Beat now, for the last time."""
        self._send(self._urgent(), now_us, is_last=True)

    def hurry_if_probing(self, now_us: int) -> None:
        """Beat faster while this robot asks for news of another one."""
        membership = self._context.membership
        if membership.is_probing:
            self._schedule.speed_up(membership.live_peer_count, now_us)

    def _urgent(self) -> Urgent:
        context, plan, leases = self._context, self._planner.plan, self._executor.leases
        digest, result = (plan.digest, plan.result) if plan else (b"", Status.RUNNING)
        is_small = context.membership.neighbourhood.is_complete
        if not is_small and context.membership.newcomers:
            digest = b""  # nobody begins before all have joined, and each changes the plan
        granted = tuple([(grant.coalition, grant.member) for grant in leases.grantor.grants()])
        accusations = context.membership.suspicions()
        is_joined, is_leaving = context.has_place, context.is_leaving
        return Urgent(
            digest,
            result,
            accusations,
            is_joined,
            is_leaving,
            leases.holder.requested,
            granted,
            context.membership.news_changes,
            self._plan_news.agrees(digest),
        )

    def _is_aside(self, urgent: Urgent, now_us: int) -> bool:
        """Whether this beat is only for those who are to hear of plans.

        Of everything else, and whenever it is time, neighbours hear: at once, and again. Of plans
        they hear the first repetition, when those who go on by them may have gone on.
        """
        last, membership = self._last, self._context.membership
        if last is None or membership.neighbourhood.is_complete:
            return False
        if urgent != last:
            self._is_owed = True
            same = urgent._replace(digest=last.digest, is_agreed=last.is_agreed)
            self._only_plans = same == last
            if not self._only_plans:
                repeats_us = self._context.config.timing.repeat_offsets_us()[-1]
                self._news_until_us = now_us + repeats_us
        elif self._is_owed or now_us <= self._news_until_us:
            self._is_owed = False
            return False
        is_for_all = urgent.sought is not None or urgent.news != self._told_news
        return self._only_plans and not is_for_all and not self._schedule.is_regular_due(now_us)

    def _audience(
        self, urgent: Urgent, number: int, now_us: int, hearers: set[str], is_aside: bool
    ) -> tuple[str, ...] | None:
        """Who hears this beat, `hearers` because of plans; None: everybody."""
        context, last, timing = self._context, self._last, self._context.config.timing
        self._last = urgent
        is_to_all = last is None or _for_all(last) != _for_all(urgent)
        if urgent.news != self._told_news and now_us >= self._news_from_us:
            # At most once per period: a team that has trouble must not make more of it.
            self._told_news, self._news_from_us = urgent.news, now_us + timing.heartbeat_us
            # If others hold a newcomer for dead they mean an earlier life of it.
            is_to_all = is_to_all or not context.is_new
        others = set(hearers)
        others.update(grant.member for grant in self._executor.leases.grantor.grants())
        if is_aside:
            return tuple(sorted(others - {context.me}))
        heard_by = context.membership.neighbourhood.audience(
            number, context.mission.robots, others, seeks=context.is_new
        )
        return None if is_to_all or urgent.sought is not None else heard_by

    def _send(self, urgent: Urgent, now_us: int, is_last: bool = False) -> None:
        context, plan, executor = self._context, self._planner.plan, self._executor
        self.hurry_if_probing(now_us)
        is_aside = self._is_aside(urgent, now_us) and not is_last
        number = self._schedule.mark_sent(urgent, now_us, is_aside)
        # A beat renews the leases that this robot holds: it answers itself first.
        granted = executor.leases.heartbeat_sent(number, now_us, executor.may_grant)
        if granted:
            executor.leases.grantor.written(context.promise(granted, now_us))
        digest, result = (plan.digest, plan.result) if plan else (bytes(8), Status.RUNNING)
        is_joined, membership = urgent.is_joined, context.membership
        hearers, section = self._plan_news.hearers(urgent.digest, urgent.is_agreed, number, now_us)
        to = self._audience(urgent, number, now_us, hearers, is_aside)
        relays = membership.relays()
        if section:
            relays = dict(sorted((relays | section).items()))
        beat = Heartbeat(
            SelfReport(context.replica.incarnation, number, digest, is_joined, int(result)),
            context.is_leaving,
            context.facts.map.digest(),
            tuple([int(status) for status in executor.tree.statuses]),
            context.work.progress,
            urgent.accusations,
            relays,
            executor.leases.holder.requested,
            executor.leases.grantor.grants(),
            membership.members_digest(context.replica.incarnation),
            context.position,
            context.work.tree_statuses,
        )
        data = context.config.engine.write_heartbeat(beat, context.replica.header)
        context.emit(Publish(MessageKind.HEARTBEAT, data, to))


def _for_all(urgent: Urgent) -> tuple[object, ...]:
    """What everybody is to hear of."""
    return urgent.is_leaving, urgent.sought
