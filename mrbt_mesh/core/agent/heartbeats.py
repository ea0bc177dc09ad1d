"""This robot's heartbeats: their contents, and when to send one.

The team's dissemination decides which robots get them (`core/membership/dissemination.py`).
"""

from __future__ import annotations

from functools import partial

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Publish
from mrbt_mesh.core.agent.parts import Parts
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.dissemination import Judges, Urgent
from mrbt_mesh.core.membership.timing import HeartbeatSchedule
from mrbt_mesh.core.membership.wire import Heartbeat, MessageKind, SelfReport
from mrbt_mesh.core.planning.plan import Plan


class Heartbeats:
    """Composes and sends this robot's heartbeats."""

    def __init__(
        self,
        context: Context,
        schedule: HeartbeatSchedule,
        tree: RobotTree,
        parts: Parts,
    ) -> None:
        self._context = context
        self._schedule = schedule
        self._tree = tree
        self._shows_clock = context.mission.stops_in_time
        self._last: Urgent | None = None
        self._parts = parts

    def send_if_due(self, plan: Plan | None, now_us: int) -> None:
        """Send a heartbeat if it is due, or if others must hear something at once."""
        urgent = self._urgent(plan)
        if self._schedule.is_due(urgent, now_us):
            self._send(plan, urgent, now_us)

    def send_if_regular(self, plan: Plan | None, now_us: int) -> None:
        """The same as `send_if_due`, for steps in which only reports of others may have changed."""
        last, is_due = self._last, now_us >= self._schedule.next_due_us
        if is_due or (last and self._agrees(last.digest) != last.is_agreed):
            self._send(plan, self._urgent(plan), now_us)

    def send(self, plan: Plan | None, now_us: int) -> None:
        """Send the last heartbeat now."""
        self._send(plan, self._urgent(plan), now_us, is_last=True)

    def hurry_if_probing(self, now_us: int) -> None:
        """Send faster while this robot asks for news of another one."""
        membership = self._context.membership
        if membership.is_probing:
            self._schedule.speed_up(membership.present_count, now_us)

    def _agrees(self, digest: bytes) -> bool:
        membership = self._context.membership
        reports = membership.report_changes + membership.member_changes
        return membership.around.agrees(digest, reports)

    def _urgent(self, plan: Plan | None) -> Urgent:
        context = self._context
        digest, result = (plan.digest, plan.result) if plan else (b"", Status.RUNNING)
        around = context.membership.around
        if around.newcomers:
            digest = b""  # no robot begins before all have joined, and each changes the plan
        return Urgent(
            digest,
            result,
            context.membership.suspicions(),
            context.has_place,
            context.is_leaving,
            self._parts.request(),
            tuple([(answer.party, answer.robot) for answer in self._parts.answers()]),
            around.broadcast_generation,
            self._agrees(digest),
        )

    def _send(self, plan: Plan | None, urgent: Urgent, now_us: int, is_last: bool = False) -> None:
        context = self._context
        membership, around = context.membership, context.membership.around
        self.hurry_if_probing(now_us)
        around.now_us = now_us
        is_regular_due = is_last or self._schedule.is_regular_due(now_us)
        plan_only = around.is_plan_only(urgent, is_regular_due)
        number = self._schedule.mark_sent(urgent, now_us, plan_only)
        for sent in self._parts.sent:
            sent(number, now_us)
        digest, result = (plan.digest, plan.result) if plan else (bytes(8), Status.RUNNING)
        waiting = None if plan is None else partial(who_waits, plan, context.facts)
        to, reports = around.route(urgent, number, plan_only, context.is_new, waiting)
        self._last = urgent
        relays = membership.relays()
        if reports:
            relays = dict(sorted({**relays, **reports}.items()))
        life, since_us = context.replica.incarnation, context.work.running_since_us
        report = SelfReport(life, number, digest, urgent.is_joined, int(result))
        beat = Heartbeat(
            membership.reports.sign(context.me, report),
            context.is_leaving,
            context.facts.map.digest(),
            tuple([int(status) for status in self._tree.statuses]),
            context.work.progress,
            urgent.suspicions,
            relays,
            self._parts.request(),
            self._parts.answers(),
            around.members_digest(life),
            context.position,
            context.work.tree_statuses,
            context.recorded,
            0 if since_us is None else (now_us - since_us) // 1_000,
            clock.unix_us(now_us) if (clock := context.wall_clock) is not None else None,
            now_us if self._shows_clock else None,
        )
        data = context.config.engine.write_heartbeat(beat, context.replica.header)
        context.emit(Publish(MessageKind.HEARTBEAT, data, to))


def who_waits(plan: Plan, facts: TeamFacts, judges: Judges) -> set[str]:
    """The robots that wait until all have the same plan: those that begin something by it, and some
    that write that something has failed for long enough, or that the mission is over.
    """
    found = set()
    for robot, assignment in plan.assignments.items():
        claim = facts.valid_claim(robot)
        runs = claim is not None and claim.phase is Phase.RUNNING
        if claim is None or not runs or claim.activation != assignment.activation:
            found.add(robot)
    failures = [failure.fact_name for failure in plan.pending_failures]
    for name in (*failures, *(loss.fact[0] for loss in plan.pending_losses)):
        found.update(judges(name))
    if plan.is_about_to_end(facts.mission):
        found.update(judges(records.RESULT))
    return found
