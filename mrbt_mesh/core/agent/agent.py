"""The agent: one robot of the team as a pure object. Inputs and time in, effects out.

`Agent.handle(input, now_us) -> list[Effect]` and `Agent.next_deadline_us(now_us)` are all there
is, with `Agent.view` to look at it; a runtime drives it with Zenoh and a real clock, the simulator
with a faulty network and a virtual one.
"""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.core.agent.commands import Commands
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.deferred_inputs import DeferredInputs
from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.executor import Executor
from mrbt_mesh.core.agent.follow_up import FollowUp
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
    InputBatch,
    InputRefused,
    JournalOpened,
    JournalReported,
    JournalSynced,
    LeaveRequested,
    MessageReceived,
    PerformanceChanged,
    PlanMade,
    PositionReported,
    ProblemFound,
    ProgressReported,
    QueryReceived,
    RouterAnswered,
    TokenChanged,
    TreeTicked,
)
from mrbt_mesh.core.agent.lifecycle import Lifecycle
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.agent.reports import Reports
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.facts.description import PROGRAM
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck
from mrbt_mesh.core.membership.heartbeat import HeartbeatSchedule
from mrbt_mesh.core.membership.leases import Leases
from mrbt_mesh.core.membership.timing import NEVER_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name


class Agent:
    """One robot. Not thread-safe; every call takes the time from one monotonic clock."""

    def __init__(self, mission: Mission, config: AgentConfig, now_us: int) -> None:
        self._context = context = Context(mission, config, now_us)
        self._schedule = schedule = HeartbeatSchedule(config.timing, now_us)
        duplicates = DuplicateIdCheck(config.robot, config.nonce, config.takeover, config.timing)
        tree = RobotTree({type_name(name) for name in config.capabilities})
        leases = Leases(config.robot, context.facts, config.timing, now_us, context.durability)
        self._planner = planner = Planner(context, tree)
        executor = Executor(context, planner, tree, leases)
        self._reports = reports = Reports(context, planner, executor, schedule)
        self._lifecycle = lifecycle = Lifecycle(context, planner, leases, duplicates, schedule)
        heartbeats = Heartbeats(context, schedule, planner, executor)
        commands = Commands(context, planner, reports)
        self._inbound = Inbound(context, executor, duplicates, schedule, commands)
        self._deferred = DeferredInputs()
        self._follow_up = FollowUp(
            context, planner, executor, reports, lifecycle, heartbeats, duplicates, now_us
        )
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
        taken: Sequence[Input] = event.inputs if isinstance(event, InputBatch) else (event,)
        if context.config.plans_apart:
            taken = self._deferred.due(taken, self._planner.awaited is not None)
        for each in taken:
            if not context.has_stopped:
                self._take(each, now_us)
        if not context.has_stopped:
            self._follow_up.inputs(taken, now_us)
        return context.take_effects()

    def next_deadline_us(self, now_us: int) -> int:
        """When to call `handle(TimerFired())` at the latest, if nothing else happens."""
        step_us = self._follow_up.step_us
        if self._context.config.plans_apart:
            if self._planner.awaited is not None:
                step_us = NEVER_US
            elif self._deferred.waits:
                step_us = now_us
        self._deadline_us = min(
            step_us,
            self._context.membership.next_detection_us,
            self._context.replica.anti_entropy.next_ask_us,
            self._schedule.next_due_us,
        )
        return self._deadline_us

    # -- one input ----------------------------------------------------------------------------

    def _take(self, event: Input, now_us: int) -> None:
        """Hand an input to the part that it concerns."""
        match event:
            case (
                MessageReceived()
                | TokenChanged()
                | RouterAnswered()
                | QueryReceived()
                | AnswerReceived()
            ):
                self._inbound.take(event, now_us, self._planner.awaited is not None)
            case InputRefused(source, reason, count):
                self._context.refuse(source, reason, count=count)
            case ActionFinished():
                self._reports.finished(event, now_us)
            case ActionStopped(ticket):
                self._context.work.stopped(ticket)
            case ProgressReported() | TreeTicked() | PositionReported():
                self._take_for_people(event)
            case LeaveRequested():
                self._reports.leave(now_us)
            case PlanMade(number, plan):
                self._planner.made(number, plan, now_us)
            case JournalSynced() | JournalReported() | JournalOpened():
                self._reports.journal(event, now_us)
            case (
                ConditionSet()
                | CapabilityChanged()
                | PerformanceChanged()
                | BidsMade()
                | ProblemFound()
            ):
                self._take_from_program(event, now_us)
            case _:
                pass  # TimerFired: what is due is followed up

    def _take_from_program(
        self,
        event: ConditionSet | CapabilityChanged | PerformanceChanged | BidsMade | ProblemFound,
        now_us: int,
    ) -> None:
        """What the robot's program says for the team."""
        match event:
            case ConditionSet(name, value):
                self._reports.set_conditions({name: value}, now_us)
            case CapabilityChanged():
                self._reports.change_capability(event, now_us)
            case PerformanceChanged(local_task, performance):
                self._reports.change_performance(local_task, performance, PROGRAM, now_us)
            case BidsMade():
                self._reports.bids_made(event, now_us)
            case ProblemFound(subject, text):
                self._reports.problem_found(subject, text, now_us)

    def _take_for_people(self, event: ProgressReported | TreeTicked | PositionReported) -> None:
        """What heartbeats carry for those who watch; nothing follows from it."""
        if isinstance(event, ProgressReported):
            self._context.work.progressed(event.ticket, event.percent)
        elif isinstance(event, TreeTicked):
            self._context.work.tree_ticked(event.ticket, event.statuses)
        else:
            self._context.position = event.position
