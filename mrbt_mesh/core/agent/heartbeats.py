"""What a robot says of itself in every beat, when it beats, and who hears it.

A small team is told everything. In a larger one beats go to neighbours (`neighbourhood`), and to
everybody what concerns everybody: a robot joins or leaves, has been declared dead or is back, seeks
a lease. Who waits for agreement, to begin something or to say that it has failed, is told what the
others have planned: by the speakers of their sections (`sections`), to whom the others tell it.
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
from mrbt_mesh.core.membership.neighbourhood import Neighbourhood
from mrbt_mesh.core.membership.sections import Sections
from mrbt_mesh.core.membership.wire import Heartbeat, MessageKind, SelfReport, Suspicion
from mrbt_mesh.core.planning.plan import Plan


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


# Attributes: what was told to whom, and until when it is told again.
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
        membership = context.membership
        self._sections = Sections(
            context.me, context.mission.robots, membership.peers, context.config.timing.reach
        )
        # What was found of the section, and what that was found from.
        self._is_agreed = False
        self._agreed_from: tuple[bytes, int, int] | None = None
        # Until when beats repeat what is told of plans.
        self._told_until_us = now_us
        self._told_news = 0
        # Only plans have changed last; neighbours have heard no beat since, which would show them
        # that they lack a fact; until when beats repeat what they are to hear.
        self._only_plans = self._is_owed = False
        self._news_until_us = now_us
        self._news_from_us = now_us
        # What is told of plans, and to which speakers. Who was told that the section agrees on
        # which plan; and who still goes by one that is no more agreed on.
        self._tells: tuple[bytes, bool, tuple[str, ...]] | None = None
        self._told: set[str] = set()
        self._told_plan: Plan | None = None
        self._misled: set[str] = set()
        self._relays_section = False

    def send_if_due(self, now_us: int) -> None:
        """Beat if it is time, or if there is something that others must hear at once."""
        urgent = self._urgent()
        if self._schedule.is_due(urgent, now_us):
            self._send(urgent, now_us)

    def send_if_regular(self, now_us: int) -> None:
        """Beat if it is time; of what others must hear at once only reports may have changed."""
        if now_us >= self._schedule.next_due_us or (
            self._last is not None and self._agrees(self._last.digest) != self._last.is_agreed
        ):
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
            self._agrees(digest),
        )

    def _agrees(self, digest: bytes) -> bool:
        """Whether this robot speaks for its section, and all of that report this plan."""
        membership = self._context.membership
        found_from = digest, membership.report_changes, membership.alive_changes
        if found_from != self._agreed_from:
            self._agreed_from = found_from
            self._is_agreed = (
                bool(digest)
                and not membership.neighbourhood.is_complete
                and self._context.me in self._sections.speakers()
                and self._sections.all_report(digest)
            )
        return self._is_agreed

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
        is_regular = self._schedule.is_regular_due(now_us) or urgent.sought is not None
        return self._only_plans and not is_regular

    def _audience(
        self, urgent: Urgent, number: int, now_us: int, is_aside: bool
    ) -> tuple[str, ...] | None:
        """Who hears this beat; None: everybody."""
        context, last, timing = self._context, self._last, self._context.config.timing
        self._last = urgent
        repeats_us = timing.repeat_offsets_us()[-1]
        is_to_all = last is None or _for_all(last) != _for_all(urgent)
        if urgent.news != self._told_news and now_us >= self._news_from_us:
            # At most once per period: a team that has trouble must not make more of it.
            self._told_news, self._news_from_us = urgent.news, now_us + timing.heartbeat_us
            is_to_all = True
        tells = urgent.digest, urgent.is_agreed, self._sections.speakers()
        speakers = tells[-1]
        if tells == self._tells:  # it is a repetition, for what was lost: to each of them in turn
            speakers = speakers[number % len(speakers) :][:1]
        else:
            self._tells = tells
            self._told_until_us = now_us + repeats_us
            self._misled = self._still_waiting()
            self._told = set()
        others = self._who_hears_of_plans(urgent, speakers, now_us)
        others.update(grant.member for grant in self._executor.leases.grantor.grants())
        if is_aside:
            return tuple(sorted(others - {context.me}))
        heard_by = context.membership.neighbourhood.audience(number, context.mission.robots, others)
        return None if is_to_all or urgent.sought is not None else heard_by

    def _still_waiting(self) -> set[str]:
        """Of those that were told of an agreement the ones that have not begun by it."""
        context, plan = self._context, self._told_plan
        if plan is None or not self._told:
            return set()
        return self._told & who_waits(plan, context.facts, context.membership.neighbourhood)

    def _who_hears_of_plans(
        self, urgent: Urgent, speakers: tuple[str, ...], now_us: int
    ) -> set[str]:
        """The speakers hear of this robot's plan; of a section's agreement, who waits for it.

        Who was told of an agreement is told when it is no more.
        """
        plan, around = self._planner.plan, self._context.membership.neighbourhood
        self._relays_section = False
        if plan is None or around.is_complete:
            return set()
        is_new = now_us <= self._told_until_us
        told = set(self._misled) if is_new else set()
        if urgent.is_agreed:
            waiting = who_waits(plan, self._context.facts, around)
            told |= waiting if is_new else waiting - self._told
            self._told |= waiting
            self._told_plan = plan
        self._relays_section = bool(told)
        return told.union(speakers) if is_new else told

    def _send(self, urgent: Urgent, now_us: int, is_last: bool = False) -> None:
        context, plan, executor = self._context, self._planner.plan, self._executor
        self.hurry_if_probing(now_us)
        is_aside = self._is_aside(urgent, now_us) and not is_last
        number = self._schedule.mark_sent(urgent, now_us, is_aside)
        # A beat renews the leases that this robot holds: it answers itself first.
        granted = executor.leases.heartbeat_sent(number, now_us, executor.may_grant)
        if granted:
            context.write(granted, now_us)
        digest, result = (plan.digest, plan.result) if plan else (bytes(8), Status.RUNNING)
        is_joined, membership = urgent.is_joined, context.membership
        to = self._audience(urgent, number, now_us, is_aside)
        relays = membership.relays()
        if self._relays_section:
            relays = dict(sorted((relays | self._sections.relays()).items()))
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
            membership.alive_digest(context.replica.incarnation),
        )
        data = context.config.engine.write_heartbeat(beat, context.replica.header)
        context.emit(Publish(MessageKind.HEARTBEAT, data, to))


def _for_all(urgent: Urgent) -> tuple[object, ...]:
    """What everybody is to hear of."""
    return urgent.is_joined, urgent.is_leaving, urgent.sought


def who_waits(plan: Plan, facts: TeamFacts, around: Neighbourhood) -> set[str]:
    """The robots that wait until all plan the same: those that the plan has begin something, and
    some that say so when it has failed something for long enough.
    """
    found = set()
    for robot, line in plan.lines.items():
        claim = facts.valid_claim(robot)
        runs = claim is not None and claim.phase is Phase.RUNNING
        if claim is None or not runs or claim.activation != line.activation:
            found.add(robot)
    verdicts = [verdict.verdict_name for verdict in plan.pending_verdicts]
    for name in (*verdicts, *(loss.fact[0] for loss in plan.pending_losses)):
        found.update(around.monitors(name))
    return found
