"""How a robot joins its team, handles pauses of its own process, and stops."""

from __future__ import annotations

from mrbt_mesh.core.agent.config import ResumedLife
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import DeclareToken
from mrbt_mesh.core.agent.parts import Parts
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Phase, TeamOrder
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.joining import Joining
from mrbt_mesh.core.membership.timing import SECOND_US, HeartbeatSchedule
from mrbt_mesh.core.mission.mission import MissionEnd
from mrbt_mesh.core.planning.plan import Plan

# After an abort robots stay until the last silent one has been silent for this long: it may be
# frozen, and would continue alone when it wakes.
ABORT_STAY_US = 10 * SECOND_US


class Lifecycle:
    """Joins, joins again after self-fencing, and stops once the mission is over.

    `done_us`: since when all robots report the mission's result. `stops_us`: when the robot then
    stops.
    """

    def __init__(
        self,
        context: Context,
        planner: Planner,
        duplicates: DuplicateIdCheck,
        schedule: HeartbeatSchedule,
        parts: Parts,
    ) -> None:
        self._context = context
        self._planner = planner
        self._duplicates = duplicates
        self._schedule = schedule
        self._parts = parts
        self.done_us: int | None = None
        self.stops_us: int | None = None

    def resume(self, life: ResumedLife, now_us: int) -> None:
        """Continue a recorded incarnation: hear the others first, as after a pause."""
        context, me = self._context, self._context.me
        context.replica.resume(life.version)
        context.description.resume(context.facts.members[me].member)
        context.emit(DeclareToken(life.version.incarnation))
        expected = context.config.expected - {me}
        context.joining = Joining(context.config.timing, expected, now_us, False, keeps_life=True)
        self._planner.deadlines.resume(life.deadlines_us, now_us)
        claim, incarnation = context.facts.valid_claim(me), life.version.incarnation
        travel_to = context.facts.under_way(me)
        context.emit(
            *context.work.resume(
                claim, life.assignment, life.partners, incarnation, now_us, travel_to
            )
        )
        for resume in self._parts.resume:
            resume(now_us)

    # -- pauses -------------------------------------------------------------------------------

    def woke_late(self, lag_us: int, now_us: int) -> bool:
        """Fence this robot if it was silent for too long, and be patient with others after any lag.

        `lag_us`: by how much it missed its deadline, which is never later than its next heartbeat.
        Returns True if it joins again.
        """
        context = self._context
        timing = context.config.timing
        if lag_us > timing.heartbeat_us // 2:
            context.membership.allow_for_own_lag(lag_us, now_us)
            context.replica.anti_entropy.allow_for_own_lag(lag_us)
        silent_us = now_us - self._schedule.last_sent_us
        if silent_us <= timing.fence_us or context.joining is not None:
            return False
        if self._has_nothing_to_lose():
            self._catch_up(silent_us, now_us)
        else:
            self._fence(silent_us, now_us)
        return True

    def _fence(self, silent_us: int, now_us: int) -> None:
        """Begin a new incarnation, as other robots may have taken over this robot's task."""
        context = self._context
        context.log("warning", "fenced", silent_s=silent_us / 1e6)
        context.emit(DeclareToken(context.replica.next_incarnation(0)))
        self._join_again(frozenset(context.membership.members()), False, now_us)
        # On disk before the first heartbeat: no later process may take this incarnation again.
        context.write([context.claim()], now_us)

    def _catch_up(self, silent_us: int, now_us: int) -> None:
        """Hear the others and their facts before taking part again, in the same incarnation."""
        context = self._context
        context.log("warning", "catches_up", silent_s=silent_us / 1e6)
        if context.work.claim is not None:
            context.work.drop()
            context.write([context.claim()], now_us)
        expected = frozenset(context.membership.members())
        self._join_again(expected, False, now_us, keeps_life=True)

    def _has_nothing_to_lose(self) -> bool:
        """True if nobody can have taken over anything from this robot.

        All robots hear of a new incarnation. Where many are slow together, as when a large team
        starts on one machine, new incarnations would add to the load that made them slow.
        """
        work = self._context.work
        has_begun = work.claim is not None and work.claim.phase is not Phase.CLAIMED
        return not has_begun and work.action is None and not self._parts.is_bound

    def join_above(self, later: Incarnation, now_us: int) -> None:
        """Join once more, above a later incarnation of this robot, which started again without
        knowing it.

        Other robots ignore its heartbeats until then. If that incarnation is still running, this
        process hears it while it joins, and stops. It listens for the whole time, since it expects
        its own id, which it never hears.
        """
        self._context.log("warning", "later_life_found", incarnation=str(later))
        self._join_again(frozenset({self._context.me}), True, now_us)

    def _join_again(
        self, expected: frozenset[str], first: bool, now_us: int, *, keeps_life: bool = False
    ) -> None:
        context = self._context
        context.emit(*context.work.drop())
        # If it no longer hears anybody, it waits like a process that has just started.
        alone_after_us = context.config.alone_after_us if expected else 0
        context.joining = Joining(
            context.config.timing,
            expected,
            now_us,
            first,
            alone_after_us=alone_after_us,
            keeps_life=keeps_life,
        )
        self._duplicates.restart()
        self._planner.forget()

    # -- joining ------------------------------------------------------------------------------

    def try_to_join(self, now_us: int) -> bool:
        """Join the team once everything is known. Returns whether the robot has just joined."""
        context, joining = self._context, self._context.joining
        if joining is None or context.is_leaving:
            return False
        around, digest = context.membership.around, context.facts.map.digest()
        wanted = joining.still_to_ask(around.near(), digest, now_us)
        context.ask(context.replica.anti_entropy.choose_to_ask(wanted, now_us), now_us)
        awaited = joining.is_first and self._duplicates.is_other_life_relayed
        team_is_there = bool(context.membership.members())
        all_there = joining.are_all_there(context.membership.peers, around.judges)
        if wanted or not joining.is_done(all_there, awaited, team_is_there, now_us):
            return False
        if not joining.keeps_life:
            ahead = sum(robot < context.me for robot in around.newcomers)
            if joining.yields(ahead, context.membership.joined_count, now_us):
                return False
        if joining.is_first:
            if joining.refusal and not context.membership.peers:
                context.stop(2, f"the team runs something else: {joining.refusal}")
                return False
            self._begin_new_life(joining)
        context.joining = None
        if joining.keeps_life:
            context.log("info", "caught_up")
            return True
        context.log("info", "joined", incarnation=str(context.replica.incarnation))
        context.write([context.member(), context.claim()], now_us)
        self._schedule.make_due(now_us)
        return True

    def _begin_new_life(self, joining: Joining) -> None:
        context = self._context
        others = context.mission.robots.keys() - {context.me}
        is_known = bool(context.facts.map.of_author(context.me))
        peers, digest = context.membership.peers, context.facts.map.digest()
        if not is_known and joining.has_all_of(others, peers, digest):
            for first_life in self._parts.first_life:
                first_life()
        context.work.is_between |= context.facts.map.get(context.me, records.CLAIM) is not None
        incarnation = context.replica.next_incarnation(self._duplicates.other_incarnation.counter)
        context.emit(DeclareToken(incarnation))

    # -- the end ------------------------------------------------------------------------------

    def result_to_stop_with(self, plan: Plan | None, now_us: int) -> Status | None:
        """The mission's result, once every living robot reports it and could hear that all do.

        None while the team stands by.
        """
        context = self._context
        self.stops_us = None
        if plan is None or not self._is_everybody_done(plan):
            self.done_us = None
        elif self.done_us is None:
            self.done_us = now_us
            event = "stands_by" if self._stands_by(plan) else "mission_over"
            context.log("info", event, result=plan.result.name.lower())
        elif context.config.exit_when_done and not self._stands_by(plan):
            self.stops_us = self.done_us + context.config.timing.heartbeat_us
            heard_us = context.membership.silent_since_us()
            if plan.command is TeamOrder.ABORT and heard_us is not None:
                self.stops_us = max(self.stops_us, heard_us + ABORT_STAY_US)
            return plan.result if now_us >= self.stops_us else None
        return None

    def _stands_by(self, plan: Plan) -> bool:
        """True if the team keeps running after T_G has ended. Never true after an abort."""
        return (
            self._context.mission.ends is MissionEnd.NEVER and plan.command is not TeamOrder.ABORT
        )

    def _is_everybody_done(self, plan: Plan) -> bool:
        """True if all report the result, with the end's digest where they know of the end."""
        context = self._context
        digest = plan.digest if plan.ended is not None else None
        return (
            context.joining is None
            and self._planner.is_over
            and not plan.is_about_to_end(context.mission)
            and context.membership.all_report_result(int(plan.result), digest)
            and context.work.action is None
        )
