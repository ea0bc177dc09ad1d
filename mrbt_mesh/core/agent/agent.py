"""The agent: one robot of the team as a pure object. Inputs and time in, effects out.

A runtime drives `Agent.handle(input, now_us) -> list[Effect]` and `Agent.next_deadline_us(now_us)`
with Zenoh and a real clock, the simulator with a faulty network and a virtual one. `Agent.view` is
for read access.

Each step takes inputs, decides what follows, and acts: it brings everything up to date in one
order, from failure detection to its own heartbeats. Most inputs change nothing that matters for
that; then the agent only sends the heartbeats that are due.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.alone import Alone
from mrbt_mesh.core.agent.commands import Commands
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.deferred_inputs import DeferredInputs
from mrbt_mesh.core.agent.effects import Effect, UseMission
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.health import Health
from mrbt_mesh.core.agent.heartbeats import Heartbeats
from mrbt_mesh.core.agent.inbound import Inbound
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.agent.job_clock import JobClock
from mrbt_mesh.core.agent.lifecycle import Lifecycle
from mrbt_mesh.core.agent.parts import Parts
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.agent.stepping import Stepping
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.description import PROGRAM
from mrbt_mesh.core.facts.records import CLOCK, Claim
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.feature import Kit
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.timing import NEVER_US, HeartbeatSchedule
from mrbt_mesh.core.membership.wire import DIGEST_BYTES
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.mission.planner_need import planner_problem
from mrbt_mesh.core.planning.outcome_tick import shown_by_tick

if TYPE_CHECKING:
    from mrbt_mesh.core.agent.scheduler import Scheduler

# Inputs of all other types are always followed by a full step.
_MAY_CHANGE_NOTHING = (
    inputs.MessageReceived,
    inputs.PositionReported,
    inputs.ProgressReported,
    inputs.RecordingSigned,
    inputs.TimerFired,
    inputs.TreeTicked,
)


class Agent:
    """One robot. Not thread-safe; every call takes the time from one monotonic clock."""

    def __init__(self, mission: Mission, config: AgentConfig, now_us: int) -> None:
        self._context = context = Context(mission, config, now_us)
        self._schedule = HeartbeatSchedule(config.timing, now_us)
        self._duplicates = DuplicateIdCheck(
            config.robot, config.nonce, config.takeover, config.timing, context.membership.reports
        )
        self._tree = tree = RobotTree({type_name(name) for name in config.capabilities})
        self._planner = Planner(context, tree)
        self._health = health = Health(context)
        self._alone = Alone(context, health)
        self._scheduler: Scheduler | None = None
        kit = Kit(context, health, self._planner, self._report, self._given_up)
        self._parts = Parts(kit)
        self._deferred = DeferredInputs()
        context.replica.shown_by_tick = partial(shown_by_tick, context.facts)
        self.view = AgentView(context, self._planner, tree)
        # The mission that the parts below were composed for, and whether it or an earlier one names
        # this robot.
        self._mission = mission
        self._was_named = config.robot in mission.robots
        self._compose(now_us)
        self._deadline_us = now_us
        # When time alone requires a full step, rather than only pulls and heartbeats.
        self._step_us = now_us
        # The value of `_changes` after the last step, None if the next input needs a full step; and
        # whether it includes the reports of other robots.
        self._seen: int | None = None
        self._reads_reports = False
        # Until when the robot waits for others that are joining, None if it does not wait.
        self._joining_until_us: int | None = None
        self._most_joined = 0
        # When the last plan was made, and when the next may be made, None if at any time.
        self._planned_us = now_us
        self._plans_at_us: int | None = None
        if config.resumed is not None:
            self._lifecycle.resume(config.resumed, now_us)

    def _compose(self, now_us: int) -> None:
        """Compose the parts that the mission in force needs."""
        context, planner, health = self._context, self._planner, self._health
        mission, schedule, duplicates = context.mission, self._schedule, self._duplicates
        parts = self._parts
        self._executor = executor = Executor(context, self._tree, parts)
        self._reports = reports = Reports(context, executor, schedule, health)
        if self._scheduler is None and mission.travel is not None:
            from mrbt_mesh.core.agent.scheduler import Scheduler

            self._scheduler = Scheduler(context)
        scheduler = executor.scheduler = self._scheduler
        self._lifecycle = Lifecycle(context, planner, duplicates, schedule, parts)
        self._heartbeats = Heartbeats(context, schedule, self._tree, parts)
        parts.compose(now_us)
        self._commands = Commands(context, reports, health, parts)
        inbound = Inbound(context, duplicates, schedule, self._commands, parts)
        self.view.stepping = Stepping(context, parts)
        jobs, work = context.facts.jobs, context.work
        self._wall_clock = clock = context.wall_clock
        self._job_clock: JobClock | None = None
        if jobs is not None and clock is not None:
            self._job_clock = JobClock(context.facts, clock)
        self._handlers: dict[type[Input], Callable[[Any, int], object]] = {
            inputs.MessageReceived: inbound.take,
            inputs.TokenChanged: inbound.take,
            inputs.RouterAnswered: inbound.take,
            inputs.QueryReceived: inbound.take,
            inputs.AnswerReceived: inbound.take,
            inputs.InputRefused: lambda e, _: context.refuse(e.source, e.reason, count=e.count),
            inputs.ActionFinished: self._action_finished,
            inputs.ActionStopped: lambda e, _: work.stopped(e.ticket),
            inputs.ProgressReported: lambda e, _: work.progressed(e.ticket, e.percent),
            inputs.TreeTicked: lambda e, _: work.tree_ticked(e.ticket, e.statuses),
            inputs.PositionReported: lambda e, _: context.note_position(e.position),
            inputs.RecordingSigned: lambda e, _: context.note_recorded(e.head),
            inputs.ConditionSet: lambda e, now: reports.set_conditions(
                {e.name: e.value}, now, e.job
            ),
            inputs.CapabilityChanged: health.change_capability,
            inputs.PerformanceChanged: lambda e, now: health.change_performance(
                e.local_task, e.performance, PROGRAM, now
            ),
            inputs.ProblemFound: health.problem_found,
            inputs.LeaveRequested: lambda _, now: reports.leave(now),
            inputs.PlanMade: planner.made,
            inputs.JournalSynced: self._journal_synced,
            inputs.JournalReported: health.journal_reported,
            inputs.RecordingReported: health.recording_reported,
            inputs.JournalOpened: health.journal_opened,
            inputs.TimerFired: lambda *_: None,
        }
        self._handlers |= {
            kind: take for part in parts.all for kind, take in part.handlers().items()
        }
        if clock is not None:
            self._handlers[inputs.WallClockRead] = lambda e, now: clock.read(e.offset_us, now)
        if scheduler is not None:
            self._handlers[inputs.ScheduleFound] = lambda e, now: scheduler.found(
                e, planner.plan, now
            )
            self._handlers[inputs.TravelTimesMade] = scheduler.travel_times_made

    def _agree(self, now_us: int) -> None:
        """Agree with the other robots on the mission in force."""
        for agree in self._parts.agree:
            agree(now_us)
        if self._context.facts.in_force is not self._mission:
            self._take_up_mission(now_us)
            if not self._context.has_stopped:
                for agree in self._parts.agree:
                    agree(now_us)

    def _take_up_mission(self, now_us: int) -> None:
        """Follow another mission that is in force: compose its parts, and continue."""
        context, mission = self._context, self._context.facts.in_force
        if problem := planner_problem(mission, context.config.lacks_planner):
            context.stop(2, problem)
            return
        self._was_named |= context.me in self._mission.robots
        claim, robot = context.work.claim, mission.robots.get(context.me)
        is_dropped = claim is not None and context.facts.task_of(claim.activation) is None
        # Computed by the previous mission, as the new one may have another task of this name.
        given_up = self._executor.given_up(claim) if claim is not None and is_dropped else []
        self._mission = mission
        context.use(mission)
        for taken_up in self._parts.taken_up:
            taken_up(mission)
        context.emit(UseMission(mission))
        if is_dropped:
            context.emit(*context.work.drop())
        if robot is not None:
            context.description.use(robot.type, robot.capabilities)
            self._tree.use({type_name(name) for name in robot.capabilities})
        context.membership.set_team(mission.robots)
        self._planner.forget()
        self._compose(now_us)
        if context.is_new:
            return
        if given_up:
            context.write([*given_up, context.claim()], now_us)
        if not self._leave_if_removed(now_us):
            said = context.facts.map.get(context.me, records.CLAIM)
            claims = [context.claim()] if is_dropped or said is None else []
            context.write([context.member(), *claims], now_us)

    def _leave_if_removed(self, now_us: int) -> bool:
        """Leave if the mission in force no longer names this robot. Returns whether it leaves."""
        context = self._context
        if not self._was_named or context.me in context.mission.robots:
            return False
        context.log("warning", "not_in_the_mission_any_more")
        self._reports.leave(now_us)
        return True

    # -- the two calls ------------------------------------------------------------------------

    def handle(self, event: Input, now_us: int) -> list[Effect]:
        """Process one input. Returns the effects, in order."""
        context = self._context
        if context.has_stopped:
            return []
        if now_us > self._deadline_us:
            if self._lifecycle.woke_late(now_us - self._deadline_us, now_us):
                self._seen = None
            self._deadline_us = now_us
        taken: Sequence[Input] = event.inputs if isinstance(event, inputs.InputBatch) else (event,)
        if context.config.plans_apart:
            taken = self._deferred.due(taken, self._planner.awaited is not None)
        for each in taken:
            if not context.has_stopped:
                self._handlers[type(each)](each, now_us)
                if context.facts.in_force is not self._mission:
                    self._take_up_mission(now_us)
        if not context.has_stopped:
            self._follow_up(taken, now_us)
        return context.take_effects()

    def next_deadline_us(self, now_us: int) -> int:
        """When to call `handle(TimerFired())` at the latest, if nothing else happens."""
        step_us = self._step_us
        if self._planner.awaited is not None:
            step_us = NEVER_US
        elif self._context.config.plans_apart and self._deferred.waits:
            step_us = now_us
        self._deadline_us = min(
            step_us,
            self._context.membership.next_detection_us,
            self._context.replica.anti_entropy.next_ask_us,
            self._schedule.next_due_us,
        )
        return self._deadline_us

    def _action_finished(self, event: inputs.ActionFinished, now_us: int) -> None:
        if True not in [finished(event, now_us) for finished in self._parts.finished]:
            self._reports.finished(event, now_us)

    def _report(self, event: inputs.ActionFinished, now_us: int) -> None:
        self._reports.finished(event, now_us)

    def _given_up(self, claim: Claim) -> list[Fact]:
        return self._executor.given_up(claim)

    def _journal_synced(self, event: inputs.JournalSynced, now_us: int) -> None:
        self._context.durability.note_synced(event.number)
        self._context.answer_kept()
        for synced in self._parts.synced:
            synced()
        self._health.report_journal(now_us)

    # -- one step -----------------------------------------------------------------------------

    def _follow_up(self, events: Sequence[Input], now_us: int) -> None:
        """Do what follows from these inputs, which have been processed."""
        clock = self._wall_clock
        if clock is not None and self._planner.awaited is None and clock.compare(now_us):
            self._health.problem_found(inputs.ProblemFound(CLOCK, clock.problem), now_us)
            self._seen = None
        if not self._alone.is_over and self._planner.awaited is None:
            self._alone.follow(now_us)
        checks = self._parts.check if self._planner.awaited is None else ()
        if True in [check(now_us) for check in checks]:
            self._seen = None
        if self._planner.awaited is not None:
            self._detect_failures(now_us)
            self._ask_who_is_due(now_us)
            self._heartbeats.send_if_due(self._planner.plan, now_us)
        elif not self._is_clean(events, now_us):
            self._reconcile(events, now_us)
            self._note_what_is_done(now_us)
        else:
            self._ask_who_is_due(now_us)
            self._heartbeats.send_if_regular(self._planner.plan, now_us)

    def _reconcile(self, events: Sequence[Input], now_us: int) -> None:
        """Bring everything up to date: the alive set, this robot's place in the team, the plan, its
        own assignment, its heartbeats.
        """
        context = self._context
        self._detect_failures(now_us)
        context.replica.follow_keys(context.alive())
        if context.joining is None:
            # From the facts, or reported by other robots.
            known = context.facts.members.get(context.me)
            later = self._duplicates.other_incarnation
            later = later if known is None else max(later, known.incarnation)
            if later > context.replica.incarnation:
                self._lifecycle.join_above(later, now_us)
        if context.joining is not None and self._lifecycle.try_to_join(now_us):
            self._reports.joined(now_us)
            self._health.joined(now_us)
            self._leave_if_removed(now_us)
        if context.joining is None:
            self._agree(now_us)
        if context.has_stopped:
            return
        if context.joining is None:
            self._plan_and_perform(events, now_us)
        self._ask_who_is_due(now_us)
        plan, result = self._planner.plan, None
        may_end = self._planner.is_over or self._lifecycle.done_us is not None
        if may_end and self._planner.awaited is None:
            result = self._lifecycle.result_to_stop_with(plan, now_us)
        if result is not None:
            self._heartbeats.send(plan, now_us)
            context.stop(0 if result is Status.SUCCESS else 1, f"mission {result.name.lower()}")
        if context.is_leaving and context.work.action is None:
            self._heartbeats.send(plan, now_us)
            context.stop(0, "left")
        else:
            self._heartbeats.send_if_due(plan, now_us)

    def _plan_and_perform(self, events: Sequence[Input], now_us: int) -> None:
        self._act_before_plan(now_us)
        for settle in self._parts.settle:
            settle(now_us)
        if self._awaits_joining(now_us) or self._awaits_news(events, now_us):
            return
        if not self._planner.is_current:
            self._planned_us = now_us
        # While a plan is made elsewhere facts must not change, as promises may require.
        apart = self._context.config.plans_apart and not self._parts.is_bound
        plan = self._planner.update(now_us, apart)
        if plan is None:
            return
        for prepare in self._parts.prepare:
            prepare(plan, now_us)
        if self._scheduler is not None:
            self._scheduler.follow(plan, now_us)
            if not self._planner.is_current:
                # The scheduler has proposed a better schedule: nothing begins by the old plan.
                plan = self._planner.update(now_us, apart)
                if plan is None:
                    return
        for perform in (self._executor.perform, *self._parts.perform):
            perform(plan, now_us)

    def _act_before_plan(self, now_us: int) -> None:
        clock = self._job_clock if self._planner.decides else None
        passed = clock.passed(now_us) if clock is not None else []
        if passed:
            self._context.write(passed, now_us)
        for follow in self._parts.follow:
            follow(now_us)

    def _awaits_joining(self, now_us: int) -> bool:
        """True if it is too early for a plan because other robots are about to join.

        Each of them changes the plan, and nobody begins before they have the plan too. The robot
        waits for them no longer than for agreement, counted from the last one that joined.
        """
        membership = self._context.membership
        if not membership.around.newcomers:
            self._joining_until_us = None
        elif self._joining_until_us is None or membership.joined_count > self._most_joined:
            self._most_joined = membership.joined_count
            self._joining_until_us = now_us + self._context.config.timing.grace_us
        return self._joining_until_us is not None and now_us < self._joining_until_us

    def _awaits_news(self, events: Sequence[Input], now_us: int) -> bool:
        """True if it is too early for a plan because another one was made just before.

        Where many robots begin at once, each of them changes everybody's plan. The robot's own
        reports are followed at once: each is a step of the tree.
        """
        self._plans_at_us = None
        are_from_others = all(
            isinstance(event, inputs.NetworkInput | inputs.TimerFired) for event in events
        )
        if self._planner.is_current or not are_from_others:
            return False
        earliest_us = self._planned_us + self._context.membership.around.plan_spacing_us
        if now_us < earliest_us:
            self._plans_at_us = earliest_us
        return now_us < earliest_us

    def _detect_failures(self, now_us: int) -> None:
        context = self._context
        if not context.membership.needs_detection(now_us):
            return
        for robot, before, after in context.membership.detect_failures(now_us):
            level = "warning" if after.is_suspected else "info"
            context.log(level, f"robot_{after}", robot=robot, before=str(before))
            if not after.is_member:
                context.replica.anti_entropy.forget(robot)
        self._heartbeats.hurry_if_probing(now_us)

    def _ask_who_is_due(self, now_us: int) -> None:
        context = self._context
        if now_us >= context.replica.anti_entropy.next_ask_us:
            digests = bytes(DIGEST_BYTES), context.members_digest()
            context.ask(context.replica.peers_to_ask(now_us, digests), now_us)

    # -- the dirty check ----------------------------------------------------------------------

    def _is_clean(self, events: Sequence[Input], now_us: int) -> bool:
        """True if nothing follows from the inputs, as is usually the case."""
        return (
            now_us < self._step_us
            and self._seen == self._changes()
            and all(isinstance(event, _MAY_CHANGE_NOTHING) for event in events)
            and not self._context.membership.needs_detection(now_us)
        )

    def _changes(self) -> int:
        """A count that grows with each change by a message that needs a full step."""
        facts, membership = self._context.facts, self._context.membership
        changes = facts.changes + membership.member_changes + membership.suspicion_changes
        changes += membership.around.broadcast_generation + self._duplicates.changes
        changes += self._context.peer_clocks.changes
        changes += self._context.replica.unproved.changes
        return changes + membership.report_changes if self._reads_reports else changes

    def _note_what_is_done(self, now_us: int) -> None:
        """Note that no full step is needed until something changes or a deadline passes."""
        context, planner = self._context, self._planner
        joining, done_us = context.joining, self._lifecycle.done_us
        starts_us = self._executor.starts_us
        deadlines_us = (
            planner.next_deadline_us(),
            self._job_clock.next_deadline_us() if self._job_clock is not None else None,
            *(next_us(now_us) for next_us in self._parts.next_us),
            self._joining_until_us,
            self._plans_at_us,
            *(self._scheduler.deadlines_us if self._scheduler is not None else ()),
            context.replica.next_unproved_us(context.membership, now_us),
            joining.deadline_us if joining is not None else None,
            joining.gathers_until_us if joining is not None else None,
            joining.alone_until_us if joining is not None else None,
            joining.yields_until_us if joining is not None else None,
            starts_us,
            self._lifecycle.stops_us,
            done_us + context.config.timing.heartbeat_us if done_us is not None else None,
        )
        ahead_us = [at for at in deadlines_us if at is not None and at > now_us]
        self._step_us = min(ahead_us, default=NEVER_US)
        self._seen = None
        if self._executor.shows_outcome:
            return
        if joining is None and not self._parts.is_bound and planner.is_current:
            awaits_reports = starts_us is not None or planner.awaits_agreement
            is_ending = done_us is not None or planner.is_over
            self._reads_reports = awaits_reports or is_ending
            self._seen = self._changes()
