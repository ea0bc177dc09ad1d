"""Keeps one robot's plan up to date, and says which facts follow from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.assignment.problem import SolverError
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.robot_tree import RobotTree
from mrbt_mesh.core.engine import MakePlan
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.coalitions import newly_broken
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.deadlines import Deadlines
from mrbt_mesh.core.planning.plan import Plan


class Planner:
    """Plans when facts or the alive set have changed, and ticks T_A for each plan.

    `dropped`: author and name of entries that no evaluation can reach any more. `failures`: what
    the robot's solver did wrong; the default one made those plans, and they are the same plans.
    """

    def __init__(
        self, me: str, facts: TeamFacts, config: AgentConfig, robot_tree: RobotTree
    ) -> None:
        self._me = me
        self.evaluator = config.engine.evaluator(facts)
        self.deadlines = Deadlines(config.timing.bid_us)
        self.plan: Plan | None = None
        self.dropped: list[tuple[str, str]] = []
        self.failures: list[str] = []
        self._facts = facts
        self._config = config
        self._make_plan = config.engine.plan_making(self.evaluator, config.solver)
        self._make_by_default: MakePlan | None = None
        self._robot_tree = robot_tree
        # Of the plan that is being made elsewhere; `number` is its.
        self._wanted: tuple[tuple[int, int], Mapping[str, Incarnation]] | None = None
        # Whether a plan is being made elsewhere: the facts must stay as they are until then.
        self.is_busy = False
        self.number = 0
        self._planned: tuple[int, int] | None = None
        self._trigger: tuple[int, tuple[str, ...]] = (0, ())

    def forget(self) -> None:
        """Plan anew at the next step, whatever has changed or is being made."""
        self._planned = self._wanted = None
        self.is_busy = False

    def is_current(self, alive_changes: int) -> bool:
        """Whether the plan is that of the facts and the alive set as they are now.

        Not so between a step's own last words (a claim) and the next step.
        """
        return self.plan is not None and self._planned == (self._facts.changes, alive_changes)

    def step(
        self,
        alive: Callable[[], Mapping[str, Incarnation]],
        alive_changes: int,
        now_us: int,
        apart: bool = False,
    ) -> list[tuple[str, Any]]:
        """Bring the plan up to date; returns facts to write, after which to step again.

        With `apart` a plan is only asked for: then `is_busy`.
        """
        facts = self._facts
        self.dropped += facts.prune(self.evaluator)
        state = (facts.changes, alive_changes)
        latched: list[tuple[str, Any]] = []
        if self.plan is None or self._planned != state:
            self._wanted = state, alive()
            self.number += 1
            if apart:
                self.is_busy = True
                return []
            latched = self.made(self.compute())
        assert self.plan is not None
        return latched + self.deadlines.expired(self.plan, facts, now_us)

    def compute(self) -> Plan:
        """The plan that is asked for. Reads the facts and changes nothing that others read."""
        assert self._wanted is not None
        return self._make(self._wanted[1])

    def made(self, plan: Plan) -> list[tuple[str, Any]]:
        """Follow the plan that was asked for; returns facts to write."""
        assert self._wanted is not None
        (self._planned, living), self._wanted, self.is_busy = self._wanted, None, False
        self.plan = plan
        self._tick_assignment(plan)
        return self._latches(plan, living)

    def _make(self, living: Mapping[str, Incarnation]) -> Plan:
        """Any exact solver leads to the same plan, so a broken one can be replaced at once."""
        try:
            return self._make_plan(self._facts, living)
        except SolverError as error:
            if self._config.solver is default_solver:
                raise
            self.failures.append(str(error))
        if self._make_by_default is None:
            plan_making = self._config.engine.plan_making
            self._make_by_default = plan_making(self.evaluator, default_solver)
        return self._make_by_default(self._facts, living)

    def _latches(self, plan: Plan, alive: Mapping[str, Incarnation]) -> list[tuple[str, Any]]:
        evaluation = plan.evaluation
        latched: list[tuple[str, Any]] = [
            (f"{records.ATTEMPT}/{scope}", number) for scope, number in evaluation.attempts
        ]
        latched += [
            (f"{records.PASSED}/{scope}/{position}", success)
            for scope, position, success in evaluation.passed
        ]
        for activation in evaluation.failures:
            if not self._facts.has_verdict(activation):
                latched.append((f"{records.VERDICT}/{activation}", True))
        for request in evaluation.requests:
            task = self._facts.mission.global_tasks[request.subject]
            if task.by_coalition:
                broken = newly_broken(self._facts, task, request.activation, alive, self._me)
                latched += [(f"{records.BROKEN}/{request.activation}/{t}", True) for t in broken]
        return latched

    def _tick_assignment(self, plan: Plan) -> None:
        requested = tuple(request.activation for request in plan.evaluation.requests)
        finished = self._facts.outcome_changes
        trigger = (finished != self._trigger[0], requested != self._trigger[1])
        self._robot_tree.tick_assignment(*trigger, plan.feasible)
        self._trigger = (finished, requested)
