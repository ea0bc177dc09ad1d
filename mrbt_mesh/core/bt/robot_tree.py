"""T_i = Parallel(T_A, T_G, T_Li, 3): the tree that every robot builds and ticks.

Source: paper, section V, equation (1). T_G is the mission's; T_A is the same everywhere; T_Li has
one branch per local task that the robot can do. All three are evaluated by the same evaluator, T_A
and T_Li over the robot's own facts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

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
            name="T_A",
        )
    )


def local_tree(local_tasks: Iterable[str]) -> Tree:
    """T_Li (paper, section V): rest while nothing is assigned, else perform what is."""
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
    return build_tree(NodeSpec(Kind.FALLBACK, (rest, *branches), name="T_Li"))


@dataclass(slots=True)
class OwnFacts:
    """A robot's own facts for one tick: which conditions hold, how its actions stand."""

    true_conditions: frozenset[str]
    actions: Mapping[str, Status] = field(default_factory=dict)
    run: str = ""

    def condition(self, name: str) -> bool:
        return name in self.true_conditions

    def turns(self, name: str, value: bool) -> int:
        return 0

    def task_status(self, subject: str, activation: str) -> Status:
        return self.actions.get(subject, Status.RUNNING)

    def attempts_used(self, activation: str) -> int:
        return 0

    def has_expired(self, activation: str) -> bool:
        return False

    def child_result(self, activation: str, position: int) -> Status | None:
        return None


# All robots tick the same few trees over the same few facts, so what came of it is kept.


@lru_cache
def assignment_status(finished: bool, requested: bool, feasible: bool) -> Status:
    """The status of T_A, ticked with these triggers and with robots assigned or no assignment."""
    holding = {CHECK_CONSISTENCY}
    if finished:
        holding.add(LOCAL_TASK_FINISHED)
    if requested:
        holding.add(NEW_GLOBAL_TASK_EXECUTED)
    solved = Status.SUCCESS if feasible else Status.FAILURE
    facts = OwnFacts(frozenset(holding), {ASSIGN_AGENTS: solved})
    return Evaluator(assignment_tree()).evaluate(facts).status


@lru_cache(maxsize=1_024)
def local_status(local_tasks: frozenset[str], assigned: str | None) -> tuple[Status, str | None]:
    """The status of T_Li and the local task that it wants to run, with this one assigned."""
    holding = {ASSIGNED, f"{ASSIGNED}({assigned})"} if assigned else set()
    found = Evaluator(local_tree(local_tasks)).evaluate(OwnFacts(frozenset(holding)))
    return found.status, found.requests[0].subject if found.requests else None


class RobotTree:
    """T_i of one robot; `statuses` are those of T_i, T_A, T_G and T_Li after the last tick."""

    def __init__(self, local_tasks: Iterable[str]) -> None:
        self._local_tasks = frozenset(local_tasks)
        self.statuses = (Status.IDLE,) * 4
        self._solved = Status.SUCCESS
        self._ticked: tuple[Status, Status, str | None] | None = None
        self._wanted: str | None = None

    def tick_assignment(self, has_finished: bool, has_new_request: bool, is_feasible: bool) -> None:
        """Tick T_A after a plan was made; without a trigger it keeps its last solved status."""
        if has_finished or has_new_request:
            self._solved = assignment_status(has_finished, has_new_request, is_feasible)

    def tick(self, global_tasks: Status, assigned: str | None) -> str | None:
        """Tick T_Li and T_i; returns the local-task type that T_Li wants to run, or None."""
        inputs = (self._solved, global_tasks, assigned)
        if inputs == self._ticked:
            return self._wanted
        local, self._wanted = local_status(self._local_tasks, assigned)
        parts = (self._solved, global_tasks, local)
        self.statuses = (parallel_status(parts, 3), *parts)
        self._ticked = inputs
        return self._wanted
