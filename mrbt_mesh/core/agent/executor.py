"""T_Li at work: follows this robot's assignment, from the claim to the action.

A robot starts once the team agrees. If the local task has a place elsewhere, it goes there first.
The *start policy* of the global task decides what else it has to wait for: `PlainStart`: nothing;
`CoalitionStart` (`coalition_start`): the other members; `LeasedStart` (`leased_start`): also the
leases of a majority.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.parts import Parts
from mrbt_mesh.core.agent.reviser import Reviser
from mrbt_mesh.core.agent.scheduler import Scheduler
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Arguments, Claim, Phase
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.validation import task_of_activation
from mrbt_mesh.core.mission.jobs import place_at
from mrbt_mesh.core.mission.mission import GlobalTask
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.plan import Plan, RobotAssignment


class Situation(NamedTuple):
    """The input of a start policy. `is_grace_over`: the robot no longer waits for other robots."""

    plan: Plan
    assignment: RobotAssignment
    claim: Claim
    is_grace_over: bool
    now_us: int


class Clearance(NamedTuple):
    """Permission to start: with this coalition, if any, after writing these facts."""

    coalition: str = ""
    facts: tuple[Fact, ...] = ()


class PlainStart:
    """Each robot starts as soon as the team agrees."""

    @property
    def needs_ready(self) -> bool:
        """Whether a robot first writes that it is ready."""
        return False

    def note_ready(self, number: int) -> None:
        """Note that the robot has promised, under this number, that it is ready."""

    def clear(self, situation: Situation) -> Clearance | None:
        """The clearance to start now; None if the robot has to wait."""
        return Clearance()

    def given_up(self, claim: Claim) -> list[Fact]:
        """The facts to write when a claim is dropped without an outcome."""
        return []


class StartPolicies(NamedTuple):
    """The start policies of the mission's tasks."""

    plain: PlainStart
    coalition: PlainStart
    leased: PlainStart | None

    def of(self, task: GlobalTask) -> PlainStart:
        """The start policy of a global task."""
        if task.exclusive and self.leased is not None:
            return self.leased
        return self.coalition if task.simultaneous else self.plain


class Executor:
    """Claims and starts the local task that the plan assigns to this robot; stops any other.

    `on_start`: called with each action that begins, and the time. `scheduler`: for a mission with
    places. `shows_outcome`: T_Li was ticked with an outcome and must be ticked again.
    """

    def __init__(
        self,
        context: Context,
        tree: RobotTree,
        starts: StartPolicies,
        reviser: Reviser,
        parts: Parts,
    ) -> None:
        self._context = context
        self._reviser = reviser
        self._starts = starts
        self._grace_us = context.config.timing.grace_us
        self.tree = tree
        self.shows_outcome = False
        self._parts = parts
        self.on_start: Callable[[StartAction, int], None] = lambda *_: None
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
                # The coalition's leader refers to this entry, even if the leader is this robot.
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
        if self._context.facts.is_revised and not self._reviser.may_begin():
            return False
        if self.scheduler is not None and now_us < (self.scheduler.settles_us or 0):
            return False
        agreed = self._context.membership.all_report_plan(plan.digest)
        return agreed or now_us >= self._grace_ends_us

    def _features_allow(self, claim: Claim, now_us: int) -> bool:
        task = self._context.facts.task_of(claim.activation)
        is_exclusive = task is not None and task.exclusive
        return False not in [may(claim, is_exclusive, now_us) for may in self._parts.may_begin]

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
        coalition = clearance.coalition
        start = work.start(claim, partners, value, life, now_us, coalition, travel_to)
        begun: list[Fact] = []
        if start.values and not context.facts.begun_with(start.activation):
            values = tuple(value for _, value in start.values)
            name = f"{records.ARGUMENTS}/{start.activation}"
            begun.append((name, Arguments(values, claim.since)))
        if self.scheduler is not None:
            begun += self.scheduler.begins(plan, claim, bool(travel_to))
        context.write([*writes, *begun, *clearance.facts, context.claim()], now_us)
        context.emit(start)
        self.on_start(start, now_us)
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

    def _start_of(self, claim: Claim) -> PlainStart | None:
        task = task_of_activation(parse_activation(claim.activation), self._context.mission)
        return self._starts.of(task) if task is not None else None

    def _type_of(self, local_task: str) -> str:
        types = self._context.mission.local_task_types
        return types.get(local_task) or type_name(local_task)  # of a job
