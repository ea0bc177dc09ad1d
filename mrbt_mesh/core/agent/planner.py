"""Keeps one robot's plan up to date, and says which facts follow from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Forget, MakePlan
from mrbt_mesh.core.assignment.problem import Solver, SolverError
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.engine import PlanFunction
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.coalitions import newly_broken
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.planning.deadlines import Deadlines
from mrbt_mesh.core.planning.plan import Plan


@dataclass(frozen=True, slots=True)
class Awaited:
    """A plan that is being made elsewhere, for these facts and this alive set."""

    number: int
    state: tuple[int, int]
    alive: Mapping[str, Incarnation]


class Planner:
    """Plans when facts or the alive set have changed, and ticks T_A for each plan.

    `plan`: the newest one, None while this robot has never joined. `awaited`: the one that is being
    made elsewhere, if there is one; until then the facts must stay as they are.
    """

    def __init__(self, context: Context, robot_tree: RobotTree) -> None:
        self.plan: Plan | None = None
        self.deadlines = Deadlines(context.config.timing.bid_wait_us)
        self._context = context
        self._robot_tree = robot_tree
        self._evaluator = context.config.engine.evaluator(context.facts)
        self._make_plan = self._plans_with(context.config.solver)
        self._make_by_default: PlanFunction | None = None
        # What the robot's solver did wrong; the default one made those plans.
        self._failures: list[str] = []
        self._number = 0
        # The facts and the alive set of the plan, of one that is being made elsewhere, and what T_A
        # had to go on.
        self._planned: tuple[int, int] | None = None
        self.awaited: Awaited | None = None
        self._trigger: tuple[int, tuple[str, ...]] = (0, ())

    def _plans_with(self, solver: Solver) -> PlanFunction:
        context = self._context
        return context.config.engine.plan_making(context.mission, self._evaluator, solver)

    def forget(self) -> None:
        """Plan anew at the next update, whatever has changed or is being made."""
        self._planned = self.awaited = None

    @property
    def is_current(self) -> bool:
        """Whether the plan is that of the facts and the alive set as they are now.

        Not so between an update's own last words (a claim) and the next one.
        """
        return self.plan is not None and self._planned == self._state()

    def _state(self) -> tuple[int, int]:
        return self._context.facts.changes, self._context.membership.alive_changes

    def update(self, now_us: int, apart: bool) -> None:
        """Plan again if facts or the alive set have changed, until nothing more follows.

        With `apart` a plan is only asked for: then it is awaited.
        """
        context, facts = self._context, self._context.facts
        dropped: list[tuple[str, str]] = []
        while True:
            dropped += facts.prune(self._evaluator)
            latches: list[tuple[str, Any]] = []
            state = self._state()
            if self.plan is None or self._planned != state:
                alive = context.alive()
                self._number += 1
                if apart:
                    self.awaited = Awaited(self._number, state, alive)
                    context.emit(MakePlan(self._number, partial(self._make, alive)))
                    break
                latches = self._follow(self._make(alive), state, alive)
            assert self.plan is not None
            latches += self.deadlines.expired(self.plan, facts, now_us)
            if not latches:
                break
            context.write(latches, now_us)
        if dropped:
            context.emit(Forget(tuple(dropped)))
        for reason in self._failures:
            if context.is_first("solver", "broke its contract"):
                context.log("error", "solver_failed", reason=reason, instead="the default solver")
        self._failures.clear()

    def made(self, number: int, plan: Plan, now_us: int) -> None:
        """Follow the plan that was asked for."""
        awaited = self.awaited
        if awaited is not None and number == awaited.number:
            self.awaited = None
            latches = self._follow(plan, awaited.state, awaited.alive)
            if latches:
                self._context.write(latches, now_us)

    def _follow(
        self, plan: Plan, state: tuple[int, int], alive: Mapping[str, Incarnation]
    ) -> list[tuple[str, Any]]:
        """Take a plan for the present one; returns facts to write."""
        self.plan, self._planned = plan, state
        self._tick_assignment(plan)
        return self._latches(plan, alive)

    def _make(self, alive: Mapping[str, Incarnation]) -> Plan:
        """Any exact solver leads to the same plan, so a broken one can be replaced at once.

        Reads the facts and changes nothing that others read.
        """
        facts = self._context.facts
        try:
            return self._make_plan(facts, alive)
        except SolverError as error:
            if self._context.config.solver is default_solver:
                raise
            self._failures.append(str(error))
        if self._make_by_default is None:
            self._make_by_default = self._plans_with(default_solver)
        return self._make_by_default(facts, alive)

    def _latches(self, plan: Plan, alive: Mapping[str, Incarnation]) -> list[tuple[str, Any]]:
        facts, evaluation = self._context.facts, plan.evaluation
        latched: list[tuple[str, Any]] = [
            (f"{records.ATTEMPT}/{scope}", number) for scope, number in evaluation.attempts
        ]
        latched += [
            (f"{records.CHILD_RESULT}/{scope}/{position}", success)
            for scope, position, success in evaluation.child_results
        ]
        for activation in evaluation.failures:
            if not facts.has_verdict(activation):
                latched.append((f"{records.VERDICT}/{activation}", True))
        for request in evaluation.requests:
            task = facts.mission.global_tasks[request.subject]
            if task.by_coalition:
                broken = newly_broken(facts, task, request.activation, alive, self._context.me)
                latched += [(f"{records.BROKEN}/{request.activation}/{t}", True) for t in broken]
        return latched

    def _tick_assignment(self, plan: Plan) -> None:
        requested = tuple(request.activation for request in plan.evaluation.requests)
        finished = self._context.facts.outcome_changes
        trigger = (finished != self._trigger[0], requested != self._trigger[1])
        self._robot_tree.tick_assignment(*trigger, plan.feasible)
        self._trigger = (finished, requested)
