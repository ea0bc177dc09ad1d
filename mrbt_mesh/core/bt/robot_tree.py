"""T_i = Parallel(T_A, T_G, T_Li, 3): the tree that every robot builds and ticks.

Source: paper, section V, equation (1). T_G is the mission's; T_A is the same everywhere; T_Li has
one branch per local task that the robot can do. All three are evaluated by the same evaluator, T_A
and T_Li over values that the robot computes itself: those of T_A are the steps of planning.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

from mrbt_mesh.core.bt.evaluation import OwnFacts
from mrbt_mesh.core.bt.evaluator import Evaluator, parallel_status
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status, Tree, build_tree

LOCAL_TASK_FINISHED = "local_task_finished"
NEW_GLOBAL_TASK_EXECUTED = "new_global_task_executed"
CHECK_CONSISTENCY = "check_consistency"
ASSIGN_AGENTS = "assign_agents"
ASSIGNED = "assigned"


def assignment_tree() -> Tree:
    """T_A (paper, section V): on a trigger, check consistency and assign agents."""
    triggers = (
        NodeSpec(Kind.CONDITION, subject=LOCAL_TASK_FINISHED),
        NodeSpec(Kind.CONDITION, subject=NEW_GLOBAL_TASK_EXECUTED),
    )
    return build_tree(
        NodeSpec(
            Kind.SEQUENCE,
            (
                NodeSpec(Kind.FALLBACK, triggers),
                NodeSpec(Kind.CONDITION, subject=CHECK_CONSISTENCY),
                NodeSpec(Kind.ACTION, subject=ASSIGN_AGENTS),
            ),
        )
    )


def local_tree(local_tasks: Iterable[str]) -> Tree:
    """T_Li (paper, section V): rest while nothing is assigned, else perform the local task.

    A local task is one leaf here; where it is a tree, the robot's program runs that.
    """
    rest = NodeSpec(Kind.INVERTER, (NodeSpec(Kind.CONDITION, subject=ASSIGNED),))
    branches = (
        NodeSpec(
            Kind.SEQUENCE,
            (
                NodeSpec(Kind.CONDITION, subject=f"{ASSIGNED}({name})"),
                NodeSpec(Kind.ACTION, subject=name),
            ),
        )
        for name in sorted(local_tasks)
    )
    return build_tree(NodeSpec(Kind.FALLBACK, (rest, *branches)))


@dataclass(frozen=True, slots=True)
class AssignmentValues:
    """The values of T_A's four leaves.

    The first two are the reasons to plan. `check_consistency`: there are no requests, or some can
    be served. `assign_agents`: Running while a plan is made, Failure if the assignment problem has
    no solution.
    """

    local_task_finished: bool
    new_global_task_executed: bool
    check_consistency: bool
    assign_agents: Status

    @property
    def is_triggered(self) -> bool:
        """Whether there is a reason to plan."""
        return self.local_task_finished or self.new_global_task_executed


# T_A has no state and is the same for all robots.
_ASSIGNMENT = Evaluator(assignment_tree())


# All robots tick the same few trees over the same few facts, so trees and results are kept.


@lru_cache(maxsize=256)
def _local_evaluator(local_tasks: frozenset[str]) -> Evaluator:
    return Evaluator(local_tree(local_tasks))


@lru_cache(maxsize=1_024)
def local_status(
    local_tasks: frozenset[str], assigned: str | None, outcome: Status = Status.RUNNING
) -> tuple[Status, str | None]:
    """The status of T_Li and the local task that it wants to run, with this one assigned.

    `outcome`: that of the local task.
    """
    holding, actions = frozenset[str](), dict[str, Status]()
    if assigned:
        holding, actions = frozenset({ASSIGNED, f"{ASSIGNED}({assigned})"}), {assigned: outcome}
    found = _local_evaluator(local_tasks).evaluate(OwnFacts(holding, actions))
    return found.status, found.requests[0].subject if found.requests else None


class RobotTree:
    """T_i of one robot.

    `statuses`: those of T_i, T_A, T_G and T_Li after the last tick; all idle before the first.
    """

    def __init__(self, local_tasks: Iterable[str]) -> None:
        self.statuses = (Status.IDLE,) * 4
        self._local_tasks = frozenset(local_tasks)
        self._assignment = Status.SUCCESS

    def use(self, local_tasks: Iterable[str]) -> None:
        """The robot can do these local tasks, by a revision of the mission."""
        self._local_tasks = frozenset(local_tasks)

    def tick_assignment(self, values: AssignmentValues) -> None:
        """Tick T_A over these values; without a trigger it keeps its last status."""
        if values.is_triggered:
            conditions = (LOCAL_TASK_FINISHED, NEW_GLOBAL_TASK_EXECUTED, CHECK_CONSISTENCY)
            holding = [name for name in conditions if getattr(values, name)]
            facts = OwnFacts(holding, {ASSIGN_AGENTS: values.assign_agents})
            self._assignment = _ASSIGNMENT.evaluate(facts).status
            if self.statuses[0] is not Status.IDLE:
                self._combine(*self.statuses[2:])

    def tick(
        self, global_tasks: Status, assigned: str | None, outcome: Status = Status.RUNNING
    ) -> str | None:
        """Tick T_Li and T_i; returns the local-task type that T_Li wants to run, or None.

        `outcome`: that of the assigned local task, Running while it has none.
        """
        local, wanted = local_status(self._local_tasks, assigned, outcome)
        self._combine(global_tasks, local)
        return wanted

    def _combine(self, global_tasks: Status, local: Status) -> None:
        """Tick T_i, the Parallel of the three."""
        parts = (self._assignment, global_tasks, local)
        self.statuses = (parallel_status(parts, 3), *parts)
