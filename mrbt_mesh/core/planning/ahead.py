"""What lies ahead: the tasks that T_G will ask for if all of them succeed.

Conditions stay as they are now, and no Timeout's time is over. Loops without a limit have no end,
so it is looked ahead for a number of tasks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mrbt_mesh.core.bt.evaluation import Evaluation, EvaluationFacts, OverlaidFacts, Request
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import Status


@dataclass
class IfTheySucceed(OverlaidFacts):
    """Facts with more successes, and with what nodes remember once these have been seen."""

    succeeded: set[str] = field(default_factory=set)
    attempts: dict[str, int] = field(default_factory=dict)
    child_results: dict[tuple[str, int], bool] = field(default_factory=dict)

    def task_status(self, subject: str, activation: str) -> Status:
        if activation in self.succeeded:
            return Status.SUCCESS
        return super().task_status(subject, activation)

    def attempts_used(self, activation: str) -> int:
        return max(super().attempts_used(activation), self.attempts.get(activation, 0))

    def child_result(self, activation: str, position: int) -> Status | None:
        success = self.child_results.get((activation, position))
        if success is None:
            return super().child_result(activation, position)
        return Status.SUCCESS if success else Status.FAILURE

    def remember(self, evaluation: Evaluation) -> None:
        """What its tick has found becomes facts."""
        self.attempts.update(evaluation.attempts)
        for activation, position, success in evaluation.child_results:
            self.child_results[activation, position] = success


def tasks_ahead(
    evaluator: Evaluator, facts: EvaluationFacts, most: int, running: str = ""
) -> tuple[Request, ...]:
    """The requests of now and of later, at most so many, in the order in which they are made.

    `running`: an activation that does not end, however long one waits.
    """
    later, found = IfTheySucceed(facts), dict[str, Request]()
    while True:
        evaluation = evaluator.evaluate(later)
        fresh = [each for each in evaluation.requests if each.activation not in found]
        for each in fresh[: most - len(found)]:
            found[each.activation] = each
            if each.activation != running:
                later.succeeded.add(each.activation)
        if not fresh or len(found) == most:
            return tuple(found.values())
        later.remember(evaluation)


def precedence(
    evaluator: Evaluator, facts: EvaluationFacts, ahead: Sequence[Request], present: int
) -> Mapping[str, tuple[str, ...]]:
    """Activation -> those that must succeed before it is asked for; both lie `ahead`.

    `present`: how many of them, the first ones, are asked for now. One is after another if it is
    not asked for while that other runs, even if all else succeeds.
    """
    after: dict[str, list[str]] = {each.activation: [] for each in ahead[present:]}
    if after:
        for before in ahead:
            reached = tasks_ahead(evaluator, facts, len(ahead) + present, before.activation)
            without = {each.activation for each in reached}
            for later, found in after.items():
                if later not in without and later != before.activation:
                    found.append(before.activation)
    return {later: tuple(found) for later, found in after.items()}
