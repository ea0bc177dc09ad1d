"""Evaluating a tree: a pure function from facts to statuses and an ordered list of requests.

This is the definition. Every kind of node has its rule in one method of `_Tick`. The statuses are
those of the paper, section III; rules for nodes that the paper does not have are those of
BehaviorTree.CPP 4. What is faster gives the same evaluations (`core.incremental`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TypeAlias

from mrbt_mesh.core.bt.activation import Activation, ActivationNames
from mrbt_mesh.core.bt.evaluation import Evaluation, EvaluationFacts, Request, RunningTimeout
from mrbt_mesh.core.bt.tree import Kind, Memory, Node, Status, parallel_status

# A status, and whether outcomes decided it: only those use up attempts.
Result: TypeAlias = tuple[Status, bool]
TickChild: TypeAlias = Callable[[int], Result]


class Evaluator(ActivationNames):
    """Evaluates one tree; what it keeps is derived from the tree alone, never from facts."""

    def evaluate(self, facts: EvaluationFacts) -> Evaluation:
        """Tick the tree once."""
        return _Tick(self, facts).run()

    def find_obsolete(
        self, known: Iterable[Activation], facts: EvaluationFacts
    ) -> Iterable[Activation]:
        """Those of the known activations that no evaluation can reach any more."""
        return [activation for activation in known if self.is_obsolete(activation, facts)]

    def forget(self) -> None:
        """Start from scratch next time, as it always does."""


class _Tick:
    """The working state of one tick. `attempts` are those of the loops around the present node."""

    def __init__(self, names: ActivationNames, facts: EvaluationFacts) -> None:
        self.names = names
        self.nodes = names.tree.nodes
        self.facts = facts
        self.attempts: list[int] = []
        self.statuses = [Status.IDLE] * len(self.nodes)
        self.requests: list[Request] = []
        self.timeouts: list[RunningTimeout] = []
        self.used_up: list[tuple[str, int]] = []
        self.failures: list[str] = []
        self.passed: list[tuple[str, int, bool]] = []
        self.kept: list[tuple[str, int, bool]] = []

    def run(self) -> Evaluation:
        self.tick(0)
        return Evaluation(
            bytes(self.statuses),
            tuple(self.requests),
            tuple(self.timeouts),
            tuple(self.used_up),
            tuple(self.failures),
            (*self.passed, *self.kept),
        )

    def tick(self, index: int) -> Result:
        """Tick a node. One that has finished asks for nothing, nor does anything below it."""
        marks = len(self.requests), len(self.timeouts), len(self.passed)
        node = self.nodes[index]
        result = self.remembering(node) if self.names.remembering[index] else self.rule(node)
        if result[0] is not Status.RUNNING:
            del self.requests[marks[0] :], self.timeouts[marks[1] :], self.passed[marks[2] :]
        self.statuses[index] = result[0]
        return result

    def rule(self, node: Node, tick: TickChild | None = None) -> Result:
        """The rule of a node's kind; `tick` is how it ticks its children."""
        tick = tick or self.tick
        match node.kind:
            case Kind.CONDITION:
                return self.condition(node)
            case Kind.ACTION:
                return self.action(node)
            case Kind.SEQUENCE:
                return in_order(node.children, Status.SUCCESS, tick)
            case Kind.FALLBACK:
                return in_order(node.children, Status.FAILURE, tick)
            case Kind.PARALLEL:
                return parallel(node, tick)
            case Kind.IF_THEN_ELSE:
                return if_then_else(node, tick)
            case Kind.TIMEOUT:
                return self.timeout(node)
            case Kind.RETRY | Kind.REPEAT | Kind.KEEP_RUNNING_UNTIL_FAILURE:
                return self.loop(node)
            case Kind.INVERTER | Kind.FORCE_SUCCESS | Kind.FORCE_FAILURE | Kind.SUBTREE:
                status, acted = tick(node.children[0])
                return decorated(node.kind, status), acted

    # -- leaves -------------------------------------------------------------------------------

    def condition(self, node: Node) -> Result:
        """Paper, section III: Success if it holds, else Failure; never Running."""
        return (Status.SUCCESS if self.facts.condition(node.subject) else Status.FAILURE), False

    def action(self, node: Node) -> Result:
        """Paper, section III: Running, which asks for robots, until its activation has a result."""
        activation = str(self.names.activation(node.index, self.attempts, self.facts))
        status = self.facts.task_status(node.subject, activation)
        if status is Status.RUNNING:
            self.requests.append(Request(node.index, node.subject, activation))
        elif status is Status.FAILURE:
            self.failures.append(activation)
        return status, status is not Status.RUNNING

    # -- what needs the facts -----------------------------------------------------------------

    def timeout(self, node: Node) -> Result:
        """BehaviorTree.CPP's Timeout: Failure once its child has run for too long.

        That the time is over is a fact, written by whoever sees it pass.
        """
        scope = str(self.names.activation(node.index, self.attempts, self.facts))
        status, acted = self.tick(node.children[0])
        if status is not Status.RUNNING:
            return status, acted
        if self.facts.has_expired(scope):
            return Status.FAILURE, True
        self.timeouts.append(RunningTimeout(node.index, scope, node.timeout_us))
        return status, acted

    def loop(self, node: Node) -> Result:
        """BehaviorTree.CPP's RetryUntilSuccessful, Repeat and KeepRunningUntilFailure.

        The child is ticked again at once when it has failed (Retry) or succeeded (Repeat), as
        another attempt, of which all activations have other names. An attempt is used up by
        outcomes, never by a condition alone: where conditions alone decide, all remaining attempts
        would end the same way at once. A limited node takes that status, one without a limit waits.
        """
        names, child = self.names, node.children[0]
        again = Status.FAILURE if node.kind is Kind.RETRY else Status.SUCCESS
        limit = names.limit(node.index)
        scope = str(names.activation(node.index, self.attempts, self.facts))
        recorded = self.facts.attempts_used(scope)
        attempt = names.attempt(node.index, recorded)
        while True:
            mark = len(self.failures)
            self.forget_statuses(child)
            self.attempts.append(attempt)
            status, acted = self.tick(child)
            self.attempts.pop()
            if status is not again or not acted or attempt + 1 == limit:
                break
            attempt += 1
            del self.failures[mark:]  # the attempt number says it for good
        if attempt > recorded:
            self.used_up.append((scope, attempt))
        if status is again and limit < 0:
            status = Status.RUNNING
        return status, acted

    def forget_statuses(self, index: int) -> None:
        """As if nothing at or below this node had been ticked."""
        self.statuses[index] = Status.IDLE
        for child in self.nodes[index].children:
            self.forget_statuses(child)

    def remembering(self, node: Node) -> Result:
        """BehaviorTree.CPP's controls with memory: children that have ended are not ticked again.

        That a child has ended, and how, is a fact under the name of the node. It is one only where
        it could end differently: without a condition below, and without another attempt, the same
        outcomes would decide it again. `Memory.UNTIL_SUCCESS` keeps the successes when it fails.
        """
        names, keeps = self.names, node.memory is Memory.UNTIL_SUCCESS
        scope = str(names.memory_activation(node.index, self.attempts, self.facts))
        ended: list[tuple[str, int, bool]] = []

        def tick(child: int) -> Result:
            if not names.has_condition[child] and not keeps:
                return self.tick(child)
            position = node.children.index(child)
            before = self.facts.child_result(scope, position)
            if before is not None:
                self.statuses[child] = before
                # What an earlier attempt has done uses up no further one.
                return before, names.has_action[child] and not keeps
            status, acted = self.tick(child)
            if status is not Status.RUNNING:
                ended.append((scope, position, status is Status.SUCCESS))
            return status, acted

        status, acted = self.rule(node, tick)
        if status is Status.RUNNING:
            self.passed += ended
        elif status is Status.FAILURE and keeps:
            self.kept += [child for child in ended if child[2]]
        return status, acted


# -- controls and decorators ------------------------------------------------------------------


def in_order(children: Sequence[int], passing: Status, tick: TickChild) -> Result:
    """Sequence (`passing` is Success) and Fallback (Failure): paper, section III.

    Children are ticked from the left until one does not return `passing`; its status is the
    node's, and what stands further right is not ticked.
    """
    any_acted = False
    for child in children:
        status, acted = tick(child)
        any_acted = any_acted or acted
        if status is not passing:
            return status, any_acted
    return passing, any_acted


def parallel(node: Node, tick: TickChild) -> Result:
    """Parallel: paper, section III. All children are ticked; `parallel_status` decides."""
    results = [tick(child) for child in node.children]
    status = parallel_status([status for status, _ in results], node.limit, node.failures)
    return status, any(acted for _, acted in results)


def if_then_else(node: Node, tick: TickChild) -> Result:
    """BehaviorTree.CPP's IfThenElse: the second child if the first succeeds, else the third.

    Without a third child the Failure of the first is its own.
    """
    status, acted = tick(node.children[0])
    branches = {Status.SUCCESS: 1, Status.FAILURE: 2}
    if status is Status.RUNNING or branches[status] >= len(node.children):
        return status, acted
    status, also_acted = tick(node.children[branches[status]])
    return status, acted or also_acted


def decorated(kind: Kind, status: Status) -> Status:
    """What a decorator makes of its child's status; Running stays Running."""
    if status is Status.RUNNING:
        return status
    match kind:
        case Kind.INVERTER:
            return Status.FAILURE if status is Status.SUCCESS else Status.SUCCESS
        case Kind.FORCE_SUCCESS:
            return Status.SUCCESS
        case Kind.FORCE_FAILURE:
            return Status.FAILURE
    return status  # a SubTree only names its child
