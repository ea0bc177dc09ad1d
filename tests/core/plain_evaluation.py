"""Evaluation in plain words: the rules one by one, at any cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mrbt_mesh.core.evaluate import Evaluation, Request, RunningTimeout, ScopeName
from mrbt_mesh.core.evaluation import EvaluationFacts
from mrbt_mesh.core.tree import ATTEMPT_KINDS, Kind, Memory, Node, Status, Tree, parallel_status

Guard = tuple[str, bool]
# A status, and whether outcomes decided it.
Result = tuple[Status, bool]


def _against(
    tree: Tree, index: int, wanted: Status, remembering: Sequence[bool]
) -> tuple[Guard, ...]:
    """Conditions that every evaluation reads below `index`, with the value that turns against it.

    `wanted` is the status that the node must keep for its right siblings to be reached. A
    composite of the same kind as its parent counts as written out in the parent. What is read
    below an IfThenElse or a `remembering` node depends on more than the present conditions.
    """
    node = tree.nodes[index]
    succeed = wanted is Status.SUCCESS
    if remembering[index]:
        return ()
    match node.kind:
        case Kind.CONDITION:
            return ((node.subject, not succeed),)
        case Kind.INVERTER:
            turned = Status.FAILURE if succeed else Status.SUCCESS
            return _against(tree, node.children[0], turned, remembering)
        case Kind.FORCE_SUCCESS | Kind.FORCE_FAILURE | Kind.ACTION | Kind.IF_THEN_ELSE:
            return ()
        case Kind.SEQUENCE:
            children = node.children if succeed else node.children[:1]
        case Kind.FALLBACK:
            children = node.children[:1] if succeed else node.children
        case _:
            children = node.children
    return tuple(g for child in children for g in _against(tree, child, wanted, remembering))


class PlainEvaluator:
    """Evaluates one tree; what it keeps is derived from the tree alone, never from facts."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        count = len(tree.nodes)
        self._guards: list[tuple[Guard, ...]] = [()] * count
        self._attempt_nodes: list[tuple[int, ...]] = [()] * count
        self._ends = [0] * count
        self.has_action = [node.kind is Kind.ACTION for node in tree.nodes]
        self.has_condition = [node.kind is Kind.CONDITION for node in tree.nodes]
        self._derive()

    def _derive(self) -> None:
        for node in reversed(self.tree.nodes):
            self._ends[node.index] = self._ends[node.children[-1]] if node.children else node.index
            for below in (self.has_action, self.has_condition):
                below[node.index] |= any(below[child] for child in node.children)
        # Where there are only conditions, a node ends in the tick in which it begins.
        self.remembering = [
            node.memory is not Memory.NONE and self.has_action[node.index]
            for node in self.tree.nodes
        ]
        for node in self.tree.nodes:
            guards = self._guards[node.index]
            attempts = self._attempt_nodes[node.index]
            if node.kind in ATTEMPT_KINDS:
                attempts = (*attempts, node.index)
            for position, child in enumerate(node.children):
                fresh = () if self.remembering[node.index] else self._fresh(node, position)
                guards = (*guards, *(guard for guard in fresh if guard not in guards))
                self._guards[child] = guards
                self._attempt_nodes[child] = attempts
                if node.kind is Kind.IF_THEN_ELSE:
                    guards = self._guards[node.index]

    def _fresh(self, node: Node, position: int) -> tuple[Guard, ...]:
        """The guards that a child has besides those of its left sibling, or of its parent."""
        if position == 0:
            return ()
        before, wanted = node.children[position - 1], Status.SUCCESS
        match node.kind:
            case Kind.SEQUENCE:
                pass
            case Kind.FALLBACK:
                wanted = Status.FAILURE
            case Kind.IF_THEN_ELSE:
                before = node.children[0]
                wanted = Status.SUCCESS if position == 1 else Status.FAILURE
            case _:
                return ()
        return _against(self.tree, before, wanted, self.remembering)

    def scope(self, node: int, attempts: Sequence[int], facts: EvaluationFacts) -> ScopeName:
        """The name of what happens at `node` under these facts and attempt numbers."""
        turns = sum(facts.turns(name, value) for name, value in self._guards[node])
        subject = self.tree.nodes[node].subject
        return ScopeName(facts.run, node, subject, tuple(attempts), turns)

    def memory_scope(self, node: int, attempts: Sequence[int], facts: EvaluationFacts) -> ScopeName:
        """The name under which a node with memory remembers: a Retry changes nothing for one that
        remembers until it succeeds.
        """
        if self.tree.nodes[node].memory is Memory.UNTIL_SUCCESS:
            outer = zip(self._attempt_nodes[node], attempts, strict=True)
            attempts = [
                0 if self.tree.nodes[index].kind is Kind.RETRY else number
                for index, number in outer
            ]
        return self.scope(node, attempts, facts)

    def used_attempts(self, node: int, recorded: int) -> int:
        """The attempt that is on, given the recorded number: never beyond the last one."""
        limit = self.limit(node)
        return recorded if limit < 0 else min(recorded, limit - 1)

    def limit(self, node: int) -> int:
        """How many attempts or cycles a node of `ATTEMPT_KINDS` has, -1: no limit."""
        repeats = self.tree.nodes[node]
        return -1 if repeats.kind is Kind.KEEP_RUNNING_UNTIL_FAILURE else repeats.limit

    def evaluate(self, facts: EvaluationFacts) -> Evaluation:
        """Tick the tree once."""
        return _Tick(self, facts).run()

    def end(self, node: int) -> int:
        """The last index of the subtree at `node`."""
        return self._ends[node]


class _Tick:
    """The working state of one evaluation."""

    def __init__(self, evaluator: PlainEvaluator, facts: EvaluationFacts) -> None:
        self.evaluator = evaluator
        self.nodes = evaluator.tree.nodes
        self.facts = facts
        self.statuses = [Status.IDLE] * len(self.nodes)
        self.requests: list[Request] = []
        self.timeouts: list[RunningTimeout] = []
        self.latches: list[tuple[str, int]] = []
        self.failures: list[str] = []
        self.passed: list[tuple[str, int, bool]] = []
        self.kept: list[tuple[str, int, bool]] = []
        self.attempts: list[int] = []

    def run(self) -> Evaluation:
        self.tick(0)
        return Evaluation(
            bytes(self.statuses),
            tuple(self.requests),
            tuple(self.timeouts),
            tuple(self.latches),
            tuple(self.failures),
            (*self.passed, *self.kept),
        )

    def tick(self, index: int) -> Result:
        marks = len(self.requests), len(self.timeouts), len(self.passed)
        status, acted = self._status(index)
        if status is not Status.RUNNING:
            # A node that has finished asks for nothing, nor does anything below it.
            del self.requests[marks[0] :], self.timeouts[marks[1] :], self.passed[marks[2] :]
        self.statuses[index] = status
        return status, acted

    def _status(self, index: int) -> Result:
        node = self.nodes[index]
        match node.kind:
            case Kind.CONDITION:
                holds = self.facts.condition(node.subject)
                return (Status.SUCCESS if holds else Status.FAILURE), False
            case Kind.ACTION:
                return self._action(index)
            case Kind.SEQUENCE | Kind.FALLBACK | Kind.PARALLEL | Kind.IF_THEN_ELSE:
                if self.evaluator.remembering[index]:
                    return self._remembering(node)
                return self._control(node, self.tick)
            case Kind.TIMEOUT:
                return self._timeout(index)
            case Kind.RETRY | Kind.REPEAT | Kind.KEEP_RUNNING_UNTIL_FAILURE:
                return self._attempts(index)
        status, acted = self.tick(node.children[0])
        return _decorated(node.kind, status), acted

    def _action(self, index: int) -> Result:
        subject = self.nodes[index].subject
        activation = str(self.evaluator.scope(index, self.attempts, self.facts))
        status = self.facts.task_status(subject, activation)
        if status is Status.RUNNING:
            self.requests.append(Request(index, subject, activation))
        elif status is Status.FAILURE:
            self.failures.append(activation)
        return status, status is not Status.RUNNING

    def _control(self, node: Node, tick: Callable[[int], Result]) -> Result:
        match node.kind:
            case Kind.SEQUENCE:
                return _in_order(node.children, Status.SUCCESS, tick)
            case Kind.FALLBACK:
                return _in_order(node.children, Status.FAILURE, tick)
            case Kind.IF_THEN_ELSE:
                status, acted = tick(node.children[0])
                branches = {Status.SUCCESS: 1, Status.FAILURE: 2}
                if status is Status.RUNNING or branches[status] >= len(node.children):
                    return status, acted
                status, also = tick(node.children[branches[status]])
                return status, acted or also
        results = [tick(child) for child in node.children]
        statuses = [status for status, _ in results]
        status = parallel_status(statuses, node.limit, node.failures)
        return status, any(acted for _, acted in results)

    def _remembering(self, node: Node) -> Result:
        """Tick a control that does not look again at children that have ended."""
        evaluator = self.evaluator
        scope = str(evaluator.memory_scope(node.index, self.attempts, self.facts))
        positions = {child: position for position, child in enumerate(node.children)}
        ended: list[tuple[str, int, bool]] = []
        keeps = node.memory is Memory.UNTIL_SUCCESS

        def tick(child: int) -> Result:
            # Without a condition or another attempt, it would end the same way again.
            if not evaluator.has_condition[child] and not keeps:
                return self.tick(child)
            before = self.facts.passed(scope, positions[child])
            if before is not None:
                self.statuses[child] = before
                # What an earlier attempt has done uses up no further one.
                return before, evaluator.has_action[child] and not keeps
            status, acted = self.tick(child)
            if status is not Status.RUNNING:
                ended.append((scope, positions[child], status is Status.SUCCESS))
            return status, acted

        status, acted = self._control(node, tick)
        if status is Status.RUNNING:
            self.passed += ended
        elif status is Status.FAILURE and keeps:
            self.kept += [child for child in ended if child[2]]
        return status, acted

    def _timeout(self, index: int) -> Result:
        node = self.nodes[index]
        scope = str(self.evaluator.scope(index, self.attempts, self.facts))
        status, acted = self.tick(node.children[0])
        if status is not Status.RUNNING:
            return status, acted
        if self.facts.expired(scope):
            return Status.FAILURE, True
        self.timeouts.append(RunningTimeout(index, scope, node.timeout_us))
        return status, acted

    def _attempts(self, index: int) -> Result:
        """Retry and Repeat: an attempt is used up by outcomes, never by a condition alone.

        Where conditions alone decide, all remaining attempts would end the same way at once:
        a limited node takes that status, one without a limit waits (RUNNING).
        """
        node = self.nodes[index]
        child = node.children[0]
        again = Status.FAILURE if node.kind is Kind.RETRY else Status.SUCCESS
        limit = self.evaluator.limit(index)
        scope = str(self.evaluator.scope(index, self.attempts, self.facts))
        recorded = self.facts.attempt(scope)
        attempt = self.evaluator.used_attempts(index, recorded)
        while True:
            first, last = child, self.evaluator.end(child)
            self.statuses[first : last + 1] = [Status.IDLE] * (last + 1 - first)
            mark = len(self.failures)
            self.attempts.append(attempt)
            status, acted = self.tick(child)
            self.attempts.pop()
            if status is not again or not acted or attempt + 1 == limit:
                break
            attempt += 1
            del self.failures[mark:]  # the attempt number says it for good
        if attempt > recorded:
            self.latches.append((scope, attempt))
        if status is again and limit < 0:
            status = Status.RUNNING
        return status, acted


def _in_order(children: Sequence[int], passing: Status, tick: Callable[[int], Result]) -> Result:
    any_acted = False
    for child in children:
        status, acted = tick(child)
        any_acted = any_acted or acted
        if status is not passing:
            return status, any_acted
    return passing, any_acted


def _decorated(kind: Kind, status: Status) -> Status:
    if status is Status.RUNNING or kind is Kind.SUBTREE:
        return status
    if kind is Kind.INVERTER:
        return Status.FAILURE if status is Status.SUCCESS else Status.SUCCESS
    return Status.SUCCESS if kind is Kind.FORCE_SUCCESS else Status.FAILURE
