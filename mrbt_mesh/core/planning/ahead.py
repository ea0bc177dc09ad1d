"""What lies ahead: the tasks that T_G will ask for if all of them succeed.

Conditions stay as they are now, and no Timeout's time is over. Loops without a limit have no end,
so it is looked ahead for a number of tasks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import Evaluation, EvaluationFacts, OverlaidFacts, Request
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import Kind, Status

ONE_AFTER_THE_OTHER = frozenset({Kind.SEQUENCE, Kind.FALLBACK, Kind.IF_THEN_ELSE})


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
    evaluator: Evaluator, facts: EvaluationFacts, evaluation: Evaluation, most: int
) -> tuple[tuple[Request, ...], ...]:
    """The requests of now, and round by round those that follow once all before have succeeded.

    `evaluation`: that of these facts. `most`: the number of requests at which it ends. Of a round
    all succeed at once: what a Parallel with fewer successes asks for until one that takes long has
    succeeded is left out.
    """
    later, found, rounds = IfTheySucceed(facts), set[str](), list[tuple[Request, ...]]()
    while True:
        fresh = [each for each in evaluation.requests if each.activation not in found]
        fresh = fresh[: most - len(found)]
        if not fresh:
            return tuple(rounds)
        rounds.append(tuple(fresh))
        found.update(each.activation for each in fresh)
        later.succeeded |= found
        later.remember(evaluation)
        evaluation = evaluator.evaluate(later)


def precedence(
    evaluator: Evaluator, rounds: Sequence[Sequence[Request]]
) -> Mapping[str, tuple[str, ...]]:
    """Activation -> those that may have to succeed before it is asked for; of `tasks_ahead`.

    One is after another of an earlier round, if both are below different children of a node that
    ticks its children one after the other, or belong to different attempts of a loop. This includes
    all that can hold it up, and sometimes a task for which a Parallel would not wait.
    """
    nodes, tasks = evaluator.tree.nodes, [each for found in rounds for each in found]
    # Sets of tasks as bit masks: those below a node, and those in one attempt of a loop.
    below = dict[int, int]()
    attempt = dict[tuple[int, tuple[int, ...]], int]()
    for number, each in enumerate(tasks):
        node = each.node
        while node >= 0:
            below[node] = below.get(node, 0) | 1 << number
            node = nodes[node].parent
        for key in _attempts(evaluator, each):
            attempt[key] = attempt.get(key, 0) | 1 << number
    result, earlier, number = dict[str, tuple[str, ...]](), 0, 0
    for found in rounds:
        for each in found:
            mask, child = 0, each.node
            while (parent := nodes[child].parent) >= 0:
                if nodes[parent].kind in ONE_AFTER_THE_OTHER:
                    mask |= below[parent] & ~below[child]
                child = parent
            for key in _attempts(evaluator, each):
                mask |= below[key[0]] & ~attempt[key]
            mask &= earlier
            before = (task.activation for bit, task in enumerate(tasks) if mask >> bit & 1)
            result[each.activation] = tuple(before)
        number += len(found)
        earlier = (1 << number) - 1
    return result


def _attempts(evaluator: Evaluator, each: Request) -> Iterator[tuple[int, tuple[int, ...]]]:
    """The loops around a request, each with the attempts of it and of those around it."""
    numbers = parse_activation(each.activation).attempts
    for position, loop in enumerate(evaluator.enclosing_loops[each.node]):
        yield loop, numbers[: position + 1]
