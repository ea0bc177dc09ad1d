"""Evaluating a tree: a pure function from facts to a status of every node and a list of requests.

This is the definition of the project's behavior trees. The table `RULES` has one function for each
kind of node. The rules are those of the paper, section III, and of BehaviorTree.CPP 4 for nodes
that the paper does not have:

| kind of node | without memory | with memory (`_Tick.remembering`) |
|---|---|---|
| Sequence | the paper's; ReactiveSequence | Sequence; SequenceWithMemory |
| Fallback | the paper's Selector; ReactiveFallback | Fallback |
| Parallel | the paper's | Parallel |
| IfThenElse | WhileDoElse | IfThenElse |
| Action, Condition | the paper's | |
| Inverter, ForceSuccess, ForceFailure, Timeout, SubTree | of the same names | |
| Retry, Repeat, KeepRunningUntilFailure | RetryUntilSuccessful, Repeat, KeepRunningUntilFailure | |
| Jobs | `_Tick.jobs` | |

Two things differ from an executor that ticks again and again. An action that has ended keeps its
outcome for as long as its activation has the same name (`activation`), so it is not run again at
the next tick. And nothing has to be halted: an action that is not requested is not carried out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TypeAlias

from mrbt_mesh.core.bt.activation import ActivationNames
from mrbt_mesh.core.bt.evaluation import (
    Evaluation,
    EvaluationFacts,
    JobEnded,
    OutcomeTick,
    OwnFacts,
    Request,
    RunningTimeout,
)
from mrbt_mesh.core.bt.guards import Expression, GuardWithActions
from mrbt_mesh.core.bt.tree import Kind, Memory, Node, Status, Tree, build_tree

# A status, and whether an outcome of an action had part in it: only those use up attempts.
Result: TypeAlias = tuple[Status, bool]
TickChild: TypeAlias = Callable[[int], Result]
Rule: TypeAlias = Callable[["_Tick", Node, TickChild], Result]


class Evaluator(ActivationNames):
    """Evaluates one tree; its caches are derived from the tree alone, never from facts."""

    def __init__(self, tree: Tree) -> None:
        super().__init__(tree)
        self._evaluators: dict[str, Evaluator] = {}
        # By node.
        self.rules = [
            _Tick.remembering if has_memory else RULES[node.kind]
            for node, has_memory in zip(tree.nodes, self.has_memory, strict=True)
        ]

    def evaluate(self, facts: EvaluationFacts) -> Evaluation:
        """Tick the tree once."""
        return _Tick(self, facts).run()

    def evaluate_outcome(
        self,
        facts: EvaluationFacts,
        activation: str,
        status: Status,
        conditions: Mapping[str, bool],
    ) -> Evaluation:
        """Tick the tree once as an action returns: see `OutcomeTick`."""
        return self.evaluate(OutcomeTick(facts, activation, status, conditions))

    def holds(self, expression: Expression, holding: Collection[str]) -> bool:
        """Whether an expression of conditions of this tree succeeds, where these hold."""
        evaluator = self._evaluators.get(expression.id)
        if evaluator is None:
            evaluator = self._evaluators[expression.id] = Evaluator(build_tree(expression.spec))
        return evaluator.evaluate(OwnFacts(holding)).status is Status.SUCCESS

    def status_at(self, node: int, facts: EvaluationFacts) -> Status:
        """The status of one node, whether a tick of the tree reaches it or not."""
        tick = _Tick(self, facts)
        tick.attempts = self.current_attempts(node, facts)
        return tick.tick(node)[0]

    def has_turned(
        self, guard: GuardWithActions, before: EvaluationFacts, now: EvaluationFacts
    ) -> bool:
        """Whether a guard has lost the status that it must have; only conditions may differ."""
        lacks_it = self.status_at(guard.node, now) is not guard.wanted
        return lacks_it and self.status_at(guard.node, before) is guard.wanted


class _Tick:
    """The working state of one tick.

    `attempts`: the attempt numbers of the loops around the present node. `child_results`:
    those that running nodes with memory have to remember; `kept_results`: those of failed ones.
    """

    def __init__(self, names: Evaluator, facts: EvaluationFacts) -> None:
        self.names = names
        self.nodes = names.tree.nodes
        self.rules = names.rules
        self.facts = facts
        self.attempts: list[int] = []
        self.statuses = [Status.IDLE] * len(self.nodes)
        self.requests: list[Request] = []
        self.timeouts: list[RunningTimeout] = []
        self.used_up: list[tuple[str, int]] = []
        self.failures: list[str] = []
        self.child_results: list[tuple[str, int, bool]] = []
        self.job_ends: list[JobEnded] = []
        self.kept_results: list[tuple[str, int, bool]] = []

    def run(self) -> Evaluation:
        """Tick the root."""
        status, _ = self.tick(0)
        return Evaluation(
            status,
            bytes(self.statuses),
            tuple(self.requests),
            tuple(self.timeouts),
            tuple(self.used_up),
            tuple(self.failures),
            (*self.child_results, *self.kept_results),
            tuple(self.job_ends),
            self.names.tree,
        )

    def tick(self, index: int) -> Result:
        """Tick a node. One that has finished asks for nothing, nor does anything below it."""
        node = self.nodes[index]
        if not node.children:
            result = self.rules[index](self, node, self.tick)
            self.statuses[index] = result[0]
            return result
        marks = len(self.requests), len(self.timeouts), len(self.child_results)
        result = self.rules[index](self, node, self.tick)
        if result[0] is not Status.RUNNING:
            del self.requests[marks[0] :], self.timeouts[marks[1] :]
            del self.child_results[marks[2] :]
        self.statuses[index] = result[0]
        return result

    # -- leaves -------------------------------------------------------------------------------

    def condition(self, node: Node, _: TickChild) -> Result:
        """Paper, section III: Success if it holds, else Failure; never Running."""
        return (Status.SUCCESS if self.facts.condition(node.subject) else Status.FAILURE), False

    def action(self, node: Node, _: TickChild) -> Result:
        """Paper, section III: Running, which is the request for it, until it has a result."""
        activation = str(self.names.activation(node.index, self.attempts, self.facts))
        status = self.facts.task_status(node.subject, activation)
        if status is Status.RUNNING:
            self.requests.append(Request(node.index, node.subject, activation))
        elif status is Status.FAILURE:
            self.failures.append(activation)
        return status, status is not Status.RUNNING

    # -- nodes that read facts ----------------------------------------------------------------

    def timeout(self, node: Node, tick: TickChild) -> Result:
        """BehaviorTree.CPP's Timeout: Failure once its child has run for too long.

        That the time is over is a fact: the first robot to see it pass writes it.
        """
        activation = str(self.names.activation(node.index, self.attempts, self.facts))
        status, has_acted = tick(node.children[0])
        if status is not Status.RUNNING:
            return status, has_acted
        if self.facts.has_expired(activation):
            return Status.FAILURE, True
        self.timeouts.append(RunningTimeout(node.index, activation, node.timeout_us))
        return status, has_acted

    def loop(self, node: Node, tick: TickChild) -> Result:
        """BehaviorTree.CPP's RetryUntilSuccessful, Repeat and KeepRunningUntilFailure.

        When the child has failed (Retry) or succeeded (the others) it is ticked again at once, as
        another attempt: all activations below have other names then. An attempt is used up by
        outcomes, never by conditions alone. Where conditions alone decide, all remaining attempts
        would end the same way at once: a node with a limit takes that status, one without waits.
        One that has used up as many attempts as it has, since a revision has given it fewer, has
        ended.
        """
        names, child = self.names, node.children[0]
        again = Status.FAILURE if node.kind is Kind.RETRY else Status.SUCCESS
        limit = names.limit(node.index)
        activation = str(names.activation(node.index, self.attempts, self.facts))
        recorded = self.facts.attempts_used(activation)
        if 0 <= limit <= recorded:
            self.reset(child)
            return again, True
        attempt = names.current_attempt(node.index, recorded)
        while True:
            mark = len(self.failures)
            self.reset(child)
            self.attempts.append(attempt)
            status, has_acted = tick(child)
            self.attempts.pop()
            if status is not again or not has_acted or attempt + 1 == limit:
                break
            attempt += 1
            del self.failures[mark:]  # the attempt number records it
        if attempt > recorded:
            self.used_up.append((activation, attempt))
        if status is again and limit < 0:
            status = Status.RUNNING
        return status, has_acted

    def jobs(self, node: Node, tick: TickChild) -> Result:
        """All open jobs are ticked, as the children of a Parallel. It goes on when they have ended,
        since others may arrive, until a job has ended of a type that ends the node.
        """
        for child in node.children:
            job, mark = self.nodes[child].job, len(self.failures)
            if not job:
                continue  # a type, in a tree that no jobs have been put into
            status, _ = tick(child)
            if status is not Status.RUNNING:
                ended = JobEnded(job, status is Status.SUCCESS, tuple(self.failures[mark:]))
                self.job_ends.append(ended)
            del self.failures[mark:]
        return self.facts.jobs_status(node.origin), True

    def reset(self, index: int) -> None:
        """As if nothing at or below this node had been ticked."""
        self.statuses[index] = Status.IDLE
        for child in self.nodes[index].children:
            self.reset(child)

    def remembering(self, node: Node, _: TickChild) -> Result:
        """A control with memory does not tick children again that have ended.

        `Memory.WHILE_RUNNING` is BehaviorTree.CPP's Sequence, Fallback, Parallel and IfThenElse:
        they remember until they have ended themselves. `Memory.UNTIL_SUCCESS` is its
        SequenceWithMemory: a failure does not make it forget the successes.

        That a child has ended, and how, is a fact under the activation of the node. It is written
        only where the child could end differently. Without a condition below, and without another
        attempt, the same outcomes would decide it again.
        """
        names, keeps = self.names, node.memory is Memory.UNTIL_SUCCESS
        activation = str(names.memory_activation(node.index, self.attempts, self.facts))
        ended: list[tuple[str, int, bool]] = []

        def tick(child: int) -> Result:
            if not names.has_condition[child] and not keeps:
                return self.tick(child)
            position = node.children.index(child)
            before = self.facts.child_result(activation, position)
            if before is not None:
                self.statuses[child] = before
                # It was remembered because something has run meanwhile, so this is not decided by
                # present conditions alone. What an earlier attempt has done uses up no further one.
                return before, not keeps
            status, has_acted = self.tick(child)
            if status is not Status.RUNNING:
                ended.append((activation, position, status is Status.SUCCESS))
            return status, has_acted

        status, has_acted = RULES[node.kind](self, node, tick)
        if status is Status.RUNNING:
            self.child_results += ended
        elif status is Status.FAILURE and keeps:
            self.kept_results += [result for result in ended if result[2]]
        return status, has_acted


# -- controls and decorators ------------------------------------------------------------------


def in_order(passing: Status, node: Node, tick: TickChild) -> Result:
    """Sequence (`passing` is Success) and Fallback (Failure): paper, section III.

    Children are ticked from the left until one does not return `passing`; its status is the
    node's, and children further right are not ticked. If all return `passing`, so does the node.
    """
    has_acted = False
    for child in node.children:
        status, child_acted = tick(child)
        has_acted = has_acted or child_acted
        if status is not passing:
            return status, has_acted
    return passing, has_acted


def parallel(node: Node, tick: TickChild) -> Result:
    """Parallel: paper, section III. All children are ticked; `parallel_status` decides."""
    results = [tick(child) for child in node.children]
    status = parallel_status([status for status, _ in results], node.limit, node.failures)
    return status, any(has_acted for _, has_acted in results)


def parallel_status(statuses: Sequence[Status], needed: int, allowed: int = 0) -> Status:
    """Success at M = `needed` successes, Failure once they are out of reach, Running otherwise.

    Paper, section III. BehaviorTree.CPP's `failure_count` comes on top: with `allowed` above 0 also
    Failure at that many failures. As there, children count from the left, and the first of these
    that comes true decides.
    """
    successes = failures = 0
    for status in statuses:
        successes += status is Status.SUCCESS
        failures += status is Status.FAILURE
        if successes >= needed:
            return Status.SUCCESS
        if len(statuses) - failures < needed or (allowed and failures >= allowed):
            return Status.FAILURE
    return Status.RUNNING


def if_then_else(node: Node, tick: TickChild) -> Result:
    """The second child if the first succeeds, the third if it fails.

    BehaviorTree.CPP's WhileDoElse, and with memory its IfThenElse. Without a third child the
    Failure of the first is its own.
    """
    status, has_acted = tick(node.children[0])
    branches = {Status.SUCCESS: 1, Status.FAILURE: 2}
    if status is Status.RUNNING or branches[status] >= len(node.children):
        return status, has_acted
    status, branch_acted = tick(node.children[branches[status]])
    return status, has_acted or branch_acted


def decorator(if_success: Status, if_failure: Status) -> Rule:
    """BehaviorTree.CPP's Inverter, ForceSuccess and ForceFailure; Running stays Running."""
    ends = {Status.SUCCESS: if_success, Status.FAILURE: if_failure}

    def rule(_: _Tick, node: Node, tick: TickChild) -> Result:
        status, has_acted = tick(node.children[0])
        return ends.get(status, status), has_acted

    return rule


RULES: Mapping[Kind, Rule] = {
    Kind.CONDITION: _Tick.condition,
    Kind.ACTION: _Tick.action,
    Kind.SEQUENCE: lambda _, node, tick: in_order(Status.SUCCESS, node, tick),
    Kind.FALLBACK: lambda _, node, tick: in_order(Status.FAILURE, node, tick),
    Kind.PARALLEL: lambda _, node, tick: parallel(node, tick),
    Kind.IF_THEN_ELSE: lambda _, node, tick: if_then_else(node, tick),
    Kind.TIMEOUT: _Tick.timeout,
    Kind.RETRY: _Tick.loop,
    Kind.REPEAT: _Tick.loop,
    Kind.KEEP_RUNNING_UNTIL_FAILURE: _Tick.loop,
    Kind.JOBS: _Tick.jobs,
    Kind.INVERTER: decorator(Status.FAILURE, Status.SUCCESS),
    Kind.FORCE_SUCCESS: decorator(Status.SUCCESS, Status.SUCCESS),
    Kind.FORCE_FAILURE: decorator(Status.FAILURE, Status.FAILURE),
    # It only names its child.
    Kind.SUBTREE: lambda _, node, tick: tick(node.children[0]),
}
