"""Keeps one robot's plan up to date, and finds the facts that follow from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Forget, MakePlan
from mrbt_mesh.core.agent.inputs import PlanMade
from mrbt_mesh.core.assignment.problem import SolverError
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.robot_tree import AssignmentValues, RobotTree
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.store import Fact, Incarnation
from mrbt_mesh.core.planning.deadlines import Deadlines
from mrbt_mesh.core.planning.derived_facts import DerivedFacts
from mrbt_mesh.core.planning.job_ends import ends_to_write
from mrbt_mesh.core.planning.make_plan import PlanFunction
from mrbt_mesh.core.planning.outcome_tick import facts_of_tree, mission_result
from mrbt_mesh.core.planning.plan import Plan

# Called with each plan that this robot adopts, and the alive set that it was made for.
PlanListener: TypeAlias = Callable[[Plan, Mapping[str, Incarnation]], None]


@dataclass(frozen=True, slots=True)
class Awaited:
    """A plan that is being made elsewhere, for these facts and this alive set.

    `values`: of T_A's leaves until the plan has been made.
    """

    number: int
    state: tuple[int, int]
    alive: Mapping[str, Incarnation]
    values: AssignmentValues


class Planner:
    """Ticks T_A: each change of facts or of the alive set leads to a new plan.

    `decides`: it writes the facts that follow; a robot without contact does not. `plan`: the newest
    one, None while this robot has never joined. `awaited`: the plan that is being made elsewhere,
    if any; until then the facts must not change. `listeners`: called before any fact changes again.
    """

    def __init__(self, context: Context, robot_tree: RobotTree) -> None:
        timing = context.config.timing
        self.plan: Plan | None = None
        self.decides = True
        self.awaited: Awaited | None = None
        self.deadlines = Deadlines(timing.detection_us, timing.failure_latch_us)
        self.listeners: list[PlanListener] = []
        self._context = context
        self._robot_tree = robot_tree
        self._make_plan = context.config.engine.plan_making(context.config.solver)
        self._make_by_default: PlanFunction | None = None
        # Errors of the robot's solver; the default solver made those plans.
        self._failures: list[str] = []
        self._number = 0
        # The state (facts and alive set) of the newest plan.
        self._planned: tuple[int, int] | None = None
        # The state and the unproved facts when these were last checked for proof.
        self._examined: tuple[int, int, int] | None = None
        # The outcomes and the alive set when T_A last planned.
        self._finished: tuple[int, int] | None = None

    def _take_up(
        self,
        plan: Plan,
        alive: Mapping[str, Incarnation],
        state: tuple[int, int],
        values: AssignmentValues,
    ) -> None:
        self.plan, self._planned = plan, state
        solved = Status.SUCCESS if plan.feasible else Status.FAILURE
        self._robot_tree.tick_assignment(
            replace(values, check_consistency=plan.consistent, assign_agents=solved)
        )
        for listener in self.listeners:
            listener(plan, alive)

    def forget(self) -> None:
        """Make a new plan at the next update."""
        self._planned = self.awaited = self._finished = None
        self.deadlines.restart_agreed()

    @property
    def is_current(self) -> bool:
        """True if the plan was made for the present facts and alive set.

        False between the facts that an update writes last (a claim) and the next update.
        """
        return self.plan is not None and self._planned == self._state()

    @property
    def is_over(self) -> bool:
        """True if the plan has the mission's result."""
        return self.plan is not None and self.plan.result in (Status.SUCCESS, Status.FAILURE)

    @property
    def awaits_agreement(self) -> bool:
        """True if a deadline has passed and a fact is written once all report the same plan."""
        return self.deadlines.awaits_agreement

    def next_deadline_us(self) -> int | None:
        """When the next deadline becomes a fact, of those that do not await agreement."""
        return self.deadlines.next_deadline_us()

    def _state(self) -> tuple[int, int]:
        return self._context.facts.changes, self._context.membership.member_changes

    def update(self, now_us: int, apart: bool) -> Plan | None:
        """Tick T_A until nothing more follows. Returns the plan, or None while it is made
        elsewhere.

        With `apart` a plan is only requested.
        """
        context, facts = self._context, self._context.facts
        dropped: list[tuple[str, str]] = []
        while True:
            dropped += self._prune()
            # Changes of guards of several conditions are written before anything is planned.
            while turned := facts.turned_guards():
                noted = [(f"{records.EXPRESSION}/{name}", changes) for name, changes in turned]
                before = facts.changes
                context.write(noted, now_us)
                dropped += self._prune()
                if facts.changes == before:
                    break  # left out: see `Replica.write`
            is_new = self._tick_assignment(apart)
            if self.awaited is not None:
                break
            assert self.plan is not None
            if self._take_shown(self.plan, now_us):
                continue
            if not self.decides:
                break
            latches = self._latches(self.plan, context.alive()) if is_new else []
            latches += self.deadlines.expired(
                self.plan, facts, now_us, self._is_agreed, context.replica.unproved.names
            )
            latches += self._end(self.plan)
            before = facts.changes
            if latches:
                context.write(latches, now_us)
            if facts.changes == before:
                break
        if dropped:
            context.commands_on_disk.forget(dropped)
            context.emit(Forget(tuple(dropped)))
        for reason in self._failures:
            if context.count_refusal("solver", "broke its contract"):
                context.log("error", "solver_failed", reason=reason, instead="the default solver")
        self._failures.clear()
        return self.plan if self.awaited is None else None

    def _prune(self) -> list[tuple[str, str]]:
        """Drop facts that nothing reads any more. A robot that is alone keeps them, as they show
        other robots how it came to its conclusions.
        """
        context = self._context
        is_alone = not context.membership.heard_count and len(context.mission.robots) > 1
        return [] if is_alone else context.facts.prune()

    def _take_shown(self, plan: Plan, now_us: int) -> bool:
        """Merge unproved facts that follow from these facts. Returns whether any were merged."""
        context, unproved = self._context, self._context.replica.unproved
        if not unproved:
            return False
        late_us = context.replica.next_unproved_us(context.membership, now_us)
        is_late = late_us is not None and late_us <= now_us
        state = (*self._state(), unproved.changes)
        if state == self._examined and not is_late:
            return False
        self._examined = state
        derived = DerivedFacts(context.facts, plan.evaluation, context.alive())
        changed = context.replica.take_shown(derived.show, context.membership, now_us)
        if changed:
            context.keep(changed)
        return bool(changed)

    def _is_agreed(self) -> bool:
        """True if all healthy robots report this plan."""
        return self.plan is not None and self._context.membership.all_report_plan(self.plan.digest)

    def made(self, event: PlanMade, now_us: int) -> None:
        """Process a plan that *Assign Agents* has made elsewhere."""
        awaited = self.awaited
        if awaited is not None and event.number == awaited.number:
            self.awaited = None
            self._take_up(event.plan, awaited.alive, awaited.state, awaited.values)
            latches = self._latches(event.plan, awaited.alive) if self.decides else []
            if latches:
                self._context.write(latches, now_us)

    # -- T_A ----------------------------------------------------------------------------------

    def _tick_assignment(self, apart: bool) -> bool:
        """Compute the values of T_A's leaves and tick it. Returns whether there is a new plan.

        A local task has finished with an outcome or the death of its robot. Any new fact may change
        the requests of T_G or the assignment problem.
        """
        context, state = self._context, self._state()
        ends = context.facts.outcome_changes, context.membership.member_changes
        values = AssignmentValues(
            self._finished != ends, self._planned != state, True, Status.RUNNING
        )
        if not values.is_triggered:
            return False
        alive = context.alive()
        self._finished = ends
        self._number += 1
        if apart:
            self.awaited = Awaited(self._number, state, alive, values)
            self._robot_tree.tick_assignment(values)
            context.emit(MakePlan(self._number, partial(self._make, alive)))
            return False
        self._take_up(self._make(alive), alive, state, values)
        return True

    def _make(self, alive: Mapping[str, Incarnation]) -> Plan:
        """Make a plan. Every exact solver gives the same plan, so the default one replaces a broken
        one.

        Reads the facts and changes nothing that others read.
        """
        facts, config = self._context.facts, self._context.config
        try:
            return self._make_plan(facts, alive)
        except SolverError as error:
            if config.solver is default_solver:
                raise
            self._failures.append(str(error))
        self._make_by_default = self._make_by_default or config.engine.plan_making(default_solver)
        return self._make_by_default(facts, alive)

    # -- the facts that follow ----------------------------------------------------------------

    def _end(self, plan: Plan) -> list[Fact]:
        """The mission has ended once all robots report that T_G has.

        In a large team, the robots that would judge a robot with this fact's name write it for all.
        """
        context, membership = self._context, self._context.membership
        if (
            plan.evaluation.status is Status.RUNNING
            or not plan.is_about_to_end(context.mission)
            or not membership.all_report_result(int(plan.result))
            or not self._is_agreed()
            or not membership.around.judges(records.RESULT)
        ):
            return []
        robots = context.mission.robots
        return mission_result(plan.result, sum(robot in robots for robot in context.alive()))

    def _latches(self, plan: Plan, alive: Mapping[str, Incarnation]) -> list[Fact]:
        facts, evaluation = self._context.facts, plan.evaluation
        latched = facts_of_tree(facts, evaluation)
        if facts.jobs is not None:
            latched += ends_to_write(facts, facts.jobs, evaluation, self._context.me, alive)
            archive = facts.jobs.to_archive(sum(robot < self._context.me for robot in alive))
            if archive is not None:
                latched.append((f"{records.JOB_ARCHIVE}/{archive[0]}", archive[1]))
        for request in evaluation.requests:
            task, activation = facts.mission.global_tasks[request.subject], request.activation
            if task.joint is not None:
                me = self._context.me
                latched += task.joint.latches(facts, task, activation, alive, me)
        return latched
