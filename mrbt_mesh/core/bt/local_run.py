"""A local task that is a tree: ticked over the robot's own facts.

Source: paper, section V, the definition of T_Li: a branch of it may be a subtree. The evaluator is
that of T_G. The facts are the robot's own and nobody else's: its conditions, how the actions of
this tree have ended, and what nodes with attempts, memory or a time limit have to remember. So they
need no author, and nothing of them outlives the local task but the conditions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mrbt_mesh.core.bt.evaluation import Evaluation, OtherConditions, PresentFacts
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import Expression, Guard
from mrbt_mesh.core.bt.tree import Status, Tree


class LocalConditions:
    """The conditions of one robot, for as long as its process lives.

    `default`: the value of a condition that nobody has set.
    """

    def __init__(self, default: Callable[[str], bool]) -> None:
        self._default = default
        self._changes: dict[str, int] = {}
        self.watchers: list[Callable[[str], None]] = []

    def value(self, name: str) -> bool:
        """Whether it holds."""
        return self._default(name) ^ bool(self._changes.get(name, 0) % 2)

    def set(self, name: str, value: bool) -> None:
        """Make it true or false, and call the watchers if that changes it."""
        if self.value(name) != value:
            self._changes[name] = self._changes.get(name, 0) + 1
            for watcher in list(self.watchers):
                watcher(name)


class LocalRun(PresentFacts):
    """One run of a local task's tree.

    Report events to it (`ended`, `returned`, `expired`, and `turned` as a watcher of conditions),
    then `tick`: the caller carries out the requests of the evaluation, and cancels those that are
    no longer among them. The local task ends when the root does, with its status.
    """

    def __init__(self, tree: Tree, conditions: LocalConditions) -> None:
        self._evaluator = Evaluator(tree)
        self._conditions = conditions
        self._outcomes: dict[str, Status] = {}
        self._attempts: dict[str, int] = {}
        self._expired: set[str] = set()
        self._child_results: dict[tuple[str, int], Status] = {}
        # How often a guard has turned to true and to false, since this run began.
        self._turns: dict[tuple[str, bool], int] = {}
        self._readers: dict[str, list[Expression]] = {}
        for expression in self._evaluator.expressions.values():
            for name in expression.conditions:
                self._readers.setdefault(name, []).append(expression)
        self._touched: dict[str, Expression] = {}
        # Values and counts at the last tick, of those that have changed since.
        self._values_before: dict[str, bool] = {}
        self._counts_before: dict[Guard, int] = {}
        self._held = {each.id: self._holds(each) for each in self._evaluator.expressions.values()}

    # -- events -------------------------------------------------------------------------------

    def ended(self, activation: str, success: bool) -> None:
        """An action has ended by itself."""
        self._outcomes[activation] = Status.SUCCESS if success else Status.FAILURE

    def returned(self, activation: str, success: bool, conditions: Mapping[str, bool]) -> Status:
        """An action has ended that sets conditions, which are to be set afterwards.

        The root's status in the tick in which it returns: if the root ends in it, it has ended.
        """
        self.ended(activation, success)
        status = self._outcomes[activation]
        found = self._evaluator.evaluate_outcome(self, activation, status, conditions)
        self._remember(found)
        return found.status

    def expired(self, activation: str) -> None:
        """The time of a Timeout is over."""
        self._expired.add(activation)

    def turned(self, name: str) -> None:
        """A condition of the robot has changed."""
        self._values_before.setdefault(name, not self._conditions.value(name))
        self._count(name, self._conditions.value(name))
        for expression in self._readers.get(name, ()):
            self._touched[expression.id] = expression

    def tick(self) -> Evaluation:
        """Evaluate the tree, until nothing more follows that nodes have to remember.

        Several conditions that decide together count as they are now: all changes between two ticks
        happen at once.
        """
        for expression in self._touched.values():
            holds = self._holds(expression)
            if holds != self._held[expression.id]:
                self._held[expression.id] = holds
                self._count(expression.id, holds)
        self._touched.clear()
        before = OtherConditions(self, self._values_before, self._counts_before)
        for guard in self._evaluator.with_actions.values() if self._values_before else ():
            if self._evaluator.has_turned(guard, before, self):
                self._count(guard.id, True)
        self._values_before.clear()
        self._counts_before.clear()
        while True:
            found = self._evaluator.evaluate(self)
            if not self._remember(found):
                return found

    def _remember(self, found: Evaluation) -> bool:
        """Keep the latched results of one tick; whether any of them is new."""
        fresh = [row for row in found.attempts if self._attempts.get(row[0], 0) < row[1]]
        results = {(a, position): success for a, position, success in found.child_results}
        is_new = bool(fresh or results.keys() - self._child_results.keys())
        self._attempts.update(fresh)
        for place, success in results.items():
            ending = Status.SUCCESS if success else Status.FAILURE
            self._child_results.setdefault(place, ending)
        return is_new

    def _count(self, guard: str, value: bool) -> None:
        count = self._turns.get((guard, value), 0)
        self._counts_before.setdefault((guard, value), count)
        self._turns[guard, value] = count + 1

    def _holds(self, expression: Expression) -> bool:
        holding = set(filter(self._conditions.value, expression.conditions))
        return self._evaluator.holds(expression, holding)

    # -- evaluation.EvaluationFacts -----------------------------------------------------------

    run = "local"

    def condition(self, name: str) -> bool:
        return self._conditions.value(name)

    def turns(self, name: str, value: bool) -> int:
        return self._turns.get((name, value), 0)

    def task_status(self, subject: str, activation: str) -> Status:
        return self._outcomes.get(activation, Status.RUNNING)

    def attempts_used(self, activation: str) -> int:
        return self._attempts.get(activation, 0)

    def has_expired(self, activation: str) -> bool:
        return activation in self._expired

    def child_result(self, activation: str, position: int) -> Status | None:
        return self._child_results.get((activation, position))
