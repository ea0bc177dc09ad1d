"""Keeps one robot's plan up to date, and says which facts follow from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mrbt_mesh.core import records
from mrbt_mesh.core.agent_config import AgentConfig
from mrbt_mesh.core.coalition import newly_broken
from mrbt_mesh.core.evaluate import Evaluator
from mrbt_mesh.core.facts import Incarnation
from mrbt_mesh.core.plan import Plan
from mrbt_mesh.core.robot_tree import RobotTree
from mrbt_mesh.core.team import TeamFacts
from mrbt_mesh.core.tree import Tree
from mrbt_mesh.core.watches import Watches


class Planner:
    """Plans when facts or the alive set have changed, and ticks T_A for each plan.

    `dropped`: author and name of entries that no evaluation can reach any more.
    """

    def __init__(
        self, me: str, tree: Tree, facts: TeamFacts, config: AgentConfig, robot_tree: RobotTree
    ) -> None:
        self._me = me
        self.evaluator = Evaluator(tree)
        self.watches = Watches()
        self.plan: Plan | None = None
        self.dropped: list[tuple[str, str]] = []
        self._facts = facts
        self._make_plan = config.functions.plan_making(self.evaluator, config.solver)
        self._robot_tree = robot_tree
        self._planned: tuple[int, int] | None = None
        self._trigger: tuple[int, tuple[str, ...]] = (0, ())

    def forget(self) -> None:
        """Plan anew at the next step, whatever has changed."""
        self._planned = None

    def is_current(self, alive_changes: int) -> bool:
        """Whether the plan is that of the facts and the alive set as they are now.

        Not so between a step's own last words (a claim) and the next step.
        """
        return self.plan is not None and self._planned == (self._facts.changes, alive_changes)

    def step(
        self, alive: Callable[[], Mapping[str, Incarnation]], alive_changes: int, now_us: int
    ) -> list[tuple[str, Any]]:
        """Bring the plan up to date; returns facts to write, after which to step again."""
        facts = self._facts
        self.dropped += facts.prune(self.evaluator)
        state = (facts.changes, alive_changes)
        latched: list[tuple[str, Any]] = []
        if self.plan is None or self._planned != state:
            self._planned = state
            living = alive()
            self.plan = self._make_plan(facts, living)
            latched = self._latches(self.plan, living)
            self._tick_assignment(self.plan)
        return latched + self.watches.expired(self.plan, facts, now_us)

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
