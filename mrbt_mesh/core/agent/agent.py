"""The agent: one robot of the team as a pure object. Inputs and time in, effects out.

`Agent.handle(input, now_us) -> list[Effect]` and `Agent.next_deadline_us(now_us)` are all there
is, with `Agent.view` to look at it; a runtime drives it with Zenoh and a real clock, the simulator
with a faulty network and a virtual one.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.commands import Commands
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.deferred_inputs import DeferredInputs
from mrbt_mesh.core.agent.dirty_check import DirtyCheck
from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.heartbeats import Heartbeats
from mrbt_mesh.core.agent.inbound import Inbound
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    ActionStopped,
    AnswerReceived,
    BidsMade,
    CapabilityChanged,
    ConditionSet,
    Input,
    LeaveRequested,
    MessageReceived,
    PlanMade,
    ProgressReported,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.agent.lifecycle import Lifecycle
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.heartbeat import HeartbeatSchedule
from mrbt_mesh.core.membership.leases import Leases
from mrbt_mesh.core.membership.timing import NEVER_US
from mrbt_mesh.core.mission.mission import Mission, type_name


class Agent:
    """One robot. Not thread-safe; every call takes the time from one monotonic clock."""

    def __init__(self, mission: Mission, config: AgentConfig, now_us: int) -> None:
        self._context = context = Context(mission, config, now_us)
        self._schedule = schedule = HeartbeatSchedule(config.timing, now_us)
        duplicates = DuplicateIdCheck(config.robot, config.nonce, config.takeover, config.timing)
        tree = RobotTree({type_name(name) for name in config.capabilities})
        leases = Leases(config.robot, context.facts, config.timing, now_us)
        self._planner = planner = Planner(context, tree)
        self._executor = executor = Executor(context, planner, tree, leases)
        self._reports = reports = Reports(context, planner, executor, schedule)
        self._lifecycle = Lifecycle(context, planner, leases, duplicates, schedule)
        self._heartbeats = Heartbeats(context, schedule, planner, executor)
        commands = Commands(context, planner, reports)
        self._inbound = Inbound(context, executor, duplicates, schedule, commands)
        self._deferred = DeferredInputs()
        self._dirty_check = DirtyCheck(context, duplicates, now_us)
        self._deadline_us = now_us
        self.view = AgentView(context, planner, executor)

    # -- the two calls ------------------------------------------------------------------------

    def handle(self, event: Input, now_us: int) -> list[Effect]:
        """Take in one input; returns what is to be done, in order."""
        context = self._context
        if context.has_stopped:
            return []
        if now_us > self._deadline_us:
            self._lifecycle.woke_late(now_us - self._deadline_us, now_us)
            self._deadline_us = now_us
        if context.config.plans_apart:
            for each in self._deferred.due(event, self._planner.awaited is not None):
                self._take(each, now_us)
        else:
            self._take(event, now_us)
        if not context.has_stopped:
            self._follow_up(event, now_us)
        return context.take_effects()

    def next_deadline_us(self, now_us: int) -> int:
        """When to call `handle(TimerFired())` at the latest, if nothing else happens."""
        step_us = self._dirty_check.step_us
        if self._context.config.plans_apart:
            if self._planner.awaited is not None:
                step_us = NEVER_US
            elif self._deferred.waits:
                step_us = now_us
        self._deadline_us = min(
            step_us,
            self._context.membership.next_detection_us,
            self._context.replica.next_ask_us,
            self._schedule.next_due_us,
        )
        return self._deadline_us

    # -- one input ----------------------------------------------------------------------------

    def _take(self, event: Input, now_us: int) -> None:
        """Hand an input to the part that it concerns."""
        match event:
            case MessageReceived() | TokenChanged() | QueryReceived() | AnswerReceived():
                self._inbound.take(event, now_us, self._planner.awaited is not None)
            case ActionFinished():
                self._reports.finished(event, now_us)
            case ActionStopped(ticket):
                self._context.work.stopped(ticket)
            case ProgressReported(ticket, percent):
                self._context.work.progressed(ticket, percent)
            case ConditionSet(name, value):
                self._reports.set_conditions({name: value}, now_us)
            case CapabilityChanged(local_task, lost):
                self._reports.change_capability(local_task, lost, now_us)
            case BidsMade():
                self._reports.bids_made(event, now_us)
            case LeaveRequested():
                self._reports.leave(now_us)
            case PlanMade(number, plan):
                self._planner.made(number, plan, now_us)
            case _:
                pass  # TimerFired: what is due is followed up

    def _follow_up(self, event: Input, now_us: int) -> None:
        """Do what follows from an input and from the time."""
        context = self._context
        if self._planner.awaited is not None:
            self._judge(now_us)
            self._ask_who_is_due(now_us)
            self._heartbeats.send_if_due(now_us)
        elif not self._dirty_check.is_clean(event, now_us):
            self._bring_up_to_date(now_us)
            self._note_what_is_done(now_us)
        else:
            if now_us >= context.replica.next_ask_us:
                self._ask_who_is_due(now_us)
            if now_us >= self._schedule.next_due_us:
                self._heartbeats.hurry_if_probing(now_us)
                self._heartbeats.send(now_us)

    def _bring_up_to_date(self, now_us: int) -> None:
        """Who is alive, the plan, this robot's line of it, and what the others must hear."""
        context, executor = self._context, self._executor
        self._judge(now_us)
        if self._lifecycle.step(now_us):
            self._reports.say_what_was_kept(now_us)
            self._schedule.make_due(now_us)
        if context.joining is None:
            executor.check_leases(now_us)
            # Leases may have to be renewed while a plan is made elsewhere, and they are facts.
            self._planner.update(now_us, context.config.plans_apart and executor.leases.is_idle)
            if self._planner.awaited is None:
                self._reports.ask_for_bids()
                executor.perform(now_us)
        self._ask_who_is_due(now_us)
        result = None
        if self._planner.awaited is None:
            result = self._lifecycle.result_to_stop_with(now_us)
        if result is not None:
            self._heartbeats.send(now_us)
            context.stop(0 if result is Status.SUCCESS else 1, f"mission {result.name.lower()}")
        if context.is_leaving and context.work.is_idle:
            self._heartbeats.send(now_us)
            context.stop(0, "left")
        else:
            self._heartbeats.send_if_due(now_us)

    def _judge(self, now_us: int) -> None:
        context = self._context
        for robot, before, after in context.membership.detect_failures(now_us):
            level = "warning" if after.is_suspected else "info"
            context.log(level, f"robot_{after}", robot=robot, before=str(before))
            if not after.is_live:
                context.replica.forget(robot)
        self._heartbeats.hurry_if_probing(now_us)

    def _ask_who_is_due(self, now_us: int) -> None:
        self._context.ask(self._context.replica.peers_to_ask(now_us), now_us)

    def _note_what_is_done(self, now_us: int) -> None:
        """Until something changes, or a deadline passes, nothing more follows."""
        context, planner, leases = self._context, self._planner, self._executor.leases
        work, done_us = context.work, self._lifecycle.done_us
        is_waiting, is_over = work.is_waiting, self._lifecycle.is_over
        deadlines_us = (
            planner.deadlines.next_deadline_us(),
            leases.next_deadline_us(),
            context.joining.deadline_us if context.joining is not None else None,
            self._executor.grace_ends_us if is_waiting else None,
            done_us + context.config.timing.heartbeat_us if done_us is not None else None,
        )
        ahead_us = [at for at in deadlines_us if at is not None and at > now_us]
        step_us = min(ahead_us, default=NEVER_US)
        if context.joining is None and leases.is_idle and planner.is_current:
            reads_reports = done_us is not None or is_waiting or is_over
            self._dirty_check.clean(reads_reports, step_us)
        else:
            self._dirty_check.spoil(step_us)
