"""Whether the living could finish a mission, by the plain evaluator over the rest of its tree.

Every way in which what they can do may end is tried out. A request that the living can serve may
succeed or fail; one that they cannot fails if a robot has failed there, or by its policy after a
time; any other blocks for ever.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.evaluation import Evaluation, OverlaidFacts, Request
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import TeamOrder
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.planning.capabilities import capabilities_of
from mrbt_mesh.core.planning.consistency import feasibility
from mrbt_mesh.core.planning.demands import demands_of

# The search ends after this many evaluations, and nothing is required of the team.
MAX_EVALUATIONS = 300


@dataclass
class Supposed(OverlaidFacts):
    """The team's facts, and what is supposed beyond them: a tree may read it."""

    statuses: Mapping[str, Status] = field(default_factory=dict)
    attempts: Mapping[str, int] = field(default_factory=dict)
    child_results: Mapping[tuple[str, int], bool] = field(default_factory=dict)
    expired: frozenset[str] = frozenset()

    def task_status(self, subject: str, activation: str) -> Status:
        supposed = self.statuses.get(activation)
        return super().task_status(subject, activation) if supposed is None else supposed

    def attempts_used(self, activation: str) -> int:
        return max(super().attempts_used(activation), self.attempts.get(activation, 0))

    def has_expired(self, activation: str) -> bool:
        return activation in self.expired or super().has_expired(activation)

    def child_result(self, activation: str, position: int) -> Status | None:
        success = self.child_results.get((activation, position))
        if success is None:
            return super().child_result(activation, position)
        return Status.SUCCESS if success else Status.FAILURE

    def with_latches(self, evaluation: Evaluation) -> Supposed:
        """With what an evaluation has found to be kept."""
        ended = {
            (scope, position): success for scope, position, success in evaluation.child_results
        }
        attempts = {**self.attempts, **dict(evaluation.attempts)}
        return replace(self, attempts=attempts, child_results={**self.child_results, **ended})


def can_finish(agent: AgentView, alive: Mapping[str, Incarnation]) -> bool:
    """Whether some behaviour of the living brings the mission to its end, Success or Failure.

    False also if too much would have to be tried out, as in a loop without end.
    """
    if agent.facts.order() is not TeamOrder.RESUME:
        return False
    return _Search(agent, alive).finds_an_end()


class _Search:
    def __init__(self, agent: AgentView, alive: Mapping[str, Incarnation]) -> None:
        self._agent = agent
        self._alive = alive
        self._capable = capabilities_of(agent.facts, alive)
        self._left = MAX_EVALUATIONS

    def finds_an_end(self) -> bool:
        """Depth first; what comes next is tried out before other ways to end what came before."""
        ways = [iter((Supposed(self._agent.facts),))]
        while ways and self._left > 0:
            supposed = next(ways[-1], None)
            if supposed is None:
                ways.pop()
                continue
            self._left -= 1
            evaluation = self._agent.mission.evaluator.evaluate(supposed)
            if evaluation.status is not Status.RUNNING:
                return True
            ways.append(self._continuations(supposed.with_latches(evaluation), evaluation))
        return False

    def _continuations(self, supposed: Supposed, evaluation: Evaluation) -> Iterator[Supposed]:
        """What may come next: the first request that can end does, one way or the other.

        In which order things end makes no difference to what can be reached, as far as it is
        looked for here. Time limits run out where nothing else may come.
        """
        for request in evaluation.requests:
            ends = self._possible_ends(request)
            for status in ends:
                statuses = {**supposed.statuses, request.activation: status}
                yield replace(supposed, statuses=statuses)
            if ends:
                return
        for timeout in evaluation.timeouts:
            yield replace(supposed, expired=supposed.expired | {timeout.activation})

    def _possible_ends(self, request: Request) -> tuple[Status, ...]:
        facts = self._agent.facts
        task = facts.mission.global_tasks[request.subject]
        if task.reads and None in facts.values_read(request.activation, task):
            return ()  # it waits for the blackboard
        plan = self._agent.plan
        if plan is not None and any(
            waiting.activation == request.activation and waiting.obstacle
            for waiting in plan.waiting
        ):
            return ()  # an exclusive task in doubt, or without a majority that lives
        present = sum(robot in facts.mission.robots for robot in self._alive)
        if task.at_most_once and 2 * present <= len(facts.mission.robots):
            return ()
        if self._can_serve(request):
            return Status.SUCCESS, Status.FAILURE
        needs = [need.local_task for need in task.needs if need.min_robots]
        results = [facts.results(request.activation, local_task) for local_task in needs]
        has_failed = any(not success for found in results for success in found.values())
        return (Status.FAILURE,) if has_failed or task.blocked_fail_after_us is not None else ()

    def _can_serve(self, request: Request) -> bool:
        agent, capable = self._agent, self._capable
        (group,) = demands_of(agent.facts, [request], capable)
        check = feasibility(agent.mission.limits, capable.team, [group])
        return check.keep(0, group, {})
