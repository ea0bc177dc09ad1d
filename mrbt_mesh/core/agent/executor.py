"""T_Li at work: follows this robot's assignment, from the claim to the action.

A robot starts once the team agrees. If the local task has a place elsewhere, it goes there first.
The *start policy* of the task (`start_policy`) decides what else it has to wait for: nothing, or
what a feature makes it wait for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.parts import Parts
from mrbt_mesh.core.agent.start_policy import PLAIN_START, Clearance, Situation, StartPolicy
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Arguments, Claim, Phase
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.validation import task_of_activation
from mrbt_mesh.core.mission.jobs import place_at
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.plan import Plan

if TYPE_CHECKING:
    from mrbt_mesh.core.agent.scheduler import Scheduler


class Executor:
    """Claims and starts the local task that the plan assigns to this robot; stops any other.

    `scheduler`: for a mission with places. `shows_outcome`: T_Li was ticked with an outcome and has
    to be ticked again.
    """

    def __init__(self, context: Context, tree: RobotTree, parts: Parts) -> None:
        self._context = context
        self._grace_us = context.config.timing.grace_us
        self.tree = tree
        self.shows_outcome = False
        self._parts = parts
        self.scheduler: Scheduler | None = None

    def perform(self, plan: Plan, now_us: int) -> None:
        """Follow the plan: cancel, claim, get ready and start."""
        context, work = self._context, self._context.work
        before, stamp = work.claim, context.facts.max_stamp + 1
        assignment = None if context.is_leaving else plan.assignments.get(context.me)
        changed, effects = work.follow(assignment, stamp, context.place, now_us)
        if effects:
            context.emit(*effects)
        writes = self.given_up(before) if changed and before is not None else []
        claim, clearance = work.claim, None
        is_news = (changed and claim != before) or work.has_arrived
        work.has_arrived = False
        is_waiting, travel_to = work.is_waiting, self._way(claim)
        if (
            is_waiting
            and assignment is not None
            and claim is not None
            and self._may_start(plan, now_us)
            and self._features_allow(claim, now_us)
        ):
            start = self._start_of(claim)
            assert start is not None  # the plan has it
            if start.needs_ready and claim.phase is Phase.CLAIMED and not travel_to:
                claim = work.get_ready(claim)
                # Facts of others, or of this robot, may refer to this entry.
                start.note_ready(context.promise([*writes, (records.CLAIM, claim)], now_us))
                writes, is_news = [], False
            is_grace_over = now_us >= self._grace_ends_us
            situation = Situation(plan, assignment, claim, is_grace_over, now_us)
            clearance = Clearance() if travel_to else start.clear(situation)
        is_cleared = clearance is not None or not is_waiting
        assigned = self._type_of(claim.local_task) if claim is not None else None
        wanted = self._tick(plan, assigned if is_cleared else None)
        if wanted is not None and clearance is not None and claim is not None:
            self._start(plan, claim, clearance, travel_to, writes, now_us)
        elif is_news:
            context.write([*writes, context.claim()], now_us)

    def _way(self, claim: Claim | None) -> str:
        """The place that the robot has to travel to before it can begin; empty if none."""
        context = self._context
        if context.mission.travel is None or claim is None:
            return ""
        if claim.phase in (Phase.READY, Phase.RUNNING):
            return ""
        goal = place_at(context.mission, claim.local_task)
        return goal if context.work.is_between or goal != context.place else ""

    def _may_start(self, plan: Plan, now_us: int) -> bool:
        """True if all healthy robots have the same plan, or the grace time has passed."""
        if self.scheduler is not None and now_us < (self.scheduler.settles_us or 0):
            return False
        agreed = self._context.membership.all_report_plan(plan.digest)
        return agreed or now_us >= self._grace_ends_us

    def _features_allow(self, claim: Claim, now_us: int) -> bool:
        return all(may(claim, now_us) for may in self._parts.may_begin)

    @property
    def _grace_ends_us(self) -> int:
        """When this robot starts its assignment even without agreement."""
        return self._context.work.assigned_us + self._grace_us

    @property
    def starts_us(self) -> int | None:
        """When it starts at the latest, if it only waits for agreement; None if it does not."""
        return self._grace_ends_us if self._context.work.is_waiting else None

    def _tick(self, plan: Plan, assigned: str | None) -> str | None:
        """Tick T_Li: first with an outcome, if there is one, then with the assignment.

        Without an assignment T_Li shows the outcome until something happens.
        """
        work = self._context.work
        ended, work.ended = work.ended, None
        self.shows_outcome = ended is not None and assigned is None
        if ended is not None:
            local_task, outcome = ended
            self.tree.tick(plan.result, self._type_of(local_task), outcome)
        return None if self.shows_outcome else self.tree.tick(plan.result, assigned)

    def _start(
        self,
        plan: Plan,
        claim: Claim,
        clearance: Clearance,
        travel_to: str,
        writes: list[Fact],
        now_us: int,
    ) -> None:
        context, work = self._context, self._context.work
        value = context.description.performance(claim.local_task)
        assert value is not None
        life, partners = context.replica.incarnation, plan.partners(context.me)
        start = work.start(claim, partners, value, life, now_us, clearance.party, travel_to)
        begun: list[Fact] = []
        if start.values and not context.facts.begun_with(start.activation):
            values = tuple(value for _, value in start.values)
            name = f"{records.ARGUMENTS}/{start.activation}"
            begun.append((name, Arguments(values, claim.since)))
        if self.scheduler is not None:
            begun += self.scheduler.begins(plan, claim, travel_to, now_us)
        context.write([*writes, *begun, *clearance.facts, context.claim()], now_us)
        context.emit(start)
        for started in self._parts.started:
            started(start, now_us)
        names = start.called
        event, place = "local_task_started", {}
        if travel_to:
            event, place = "set_out", {"place": travel_to}
        context.log("info", event, **names, activation=start.activation, **place)

    def given_up(self, claim: Claim) -> list[Fact]:
        """The facts to write when a claim is dropped without an outcome, according to the mission
        that this robot follows; none if the mission has no such step.
        """
        start = self._start_of(claim)
        return start.given_up(claim) if start is not None else []

    def _start_of(self, claim: Claim) -> StartPolicy | None:
        task = task_of_activation(parse_activation(claim.activation), self._context.mission)
        if task is None or task.joint is None:
            return PLAIN_START if task is not None else None
        return self._parts.start_policy(task) or PLAIN_START

    def _type_of(self, local_task: str) -> str:
        types = self._context.mission.local_task_types
        return types.get(local_task) or type_name(local_task)  # of a job
