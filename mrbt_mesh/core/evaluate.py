"""Evaluating a tree: a pure function from facts to statuses and an ordered list of requests.

No node remembers anything. What a memoryless tree would forget or repeat is decided by the
name of an *activation*: it is made of the leaf, the attempt numbers of the enclosing
Retry/Repeat nodes, and how often the leaf's guards have turned against it. Same facts, same
name, on every robot; a guard that flipped and flipped back gives a new name, so the work is
done again. Statuses are those of the paper, section III.

Nodes with memory (`tree.Memory`) do not look again at children that have ended: that these
have is a fact, under the name of the node. What such a child read is no guard of what follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mrbt_mesh.core.layout import Layout
from mrbt_mesh.core.tick import EvaluationFacts, Functions, Tick, memory_text
from mrbt_mesh.core.tree import Status, Tree

_STATUSES = tuple(Status)


@dataclass(frozen=True, slots=True)
class Request:
    """A running action leaf: what it asks for, under which activation."""

    node: int
    subject: str
    activation: str


@dataclass(frozen=True, slots=True)
class RunningTimeout:
    """A Timeout whose child runs; whoever sees `timeout_us` pass records that it expired."""

    node: int
    scope: str
    timeout_us: int


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The outcome of one tick: a status per node, requests in tree order, facts to record.

    `statuses` has one byte per node, the value of its `Status`. `attempts` are (scope, attempt
    number) pairs that have become true by this evaluation, and `passed` (scope, position, success)
    of children that nodes with memory have done with; `failures` are the activations of the
    actions that were ticked and have failed, used-up attempts left out.
    """

    statuses: bytes
    requests: tuple[Request, ...]
    timeouts: tuple[RunningTimeout, ...]
    attempts: tuple[tuple[str, int], ...]
    failures: tuple[str, ...]
    passed: tuple[tuple[str, int, bool], ...]

    @property
    def status(self) -> Status:
        """The root's status."""
        return _STATUSES[self.statuses[0]]

    def status_of(self, node: int) -> Status:
        """The status of one node."""
        return _STATUSES[self.statuses[node]]


@dataclass(frozen=True, slots=True)
class ScopeName:
    """The parts of an activation's or attempt counter's name, for comparison."""

    run: str
    node: int
    subject: str
    attempts: tuple[int, ...]
    turns: int

    def __str__(self) -> str:
        attempts = ".".join(map(str, self.attempts))
        return f"{self.run}:{self.node}:{self.subject}:{attempts}:{self.turns}"


def parse_scope(text: str) -> ScopeName:
    """The inverse of `str(ScopeName)`; raises ValueError if it is none."""
    run, node, subject, attempts, turns = text.split(":")
    numbers = tuple(int(part) for part in attempts.split(".")) if attempts else ()
    return ScopeName(run, int(node), subject, numbers, int(turns))


class Evaluator:
    """Evaluates one tree; what it keeps is derived from the tree alone, never from facts."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.layout = Layout(tree)
        self.functions = Functions(self.layout)

    def turns_at(self, node: int, facts: EvaluationFacts) -> int:
        """How often the guards of a node have turned against it."""
        guards = self.layout.guards
        return sum(facts.turns(*guards[number]) for number in self.layout.guards_at(node))

    def scope(self, node: int, attempts: Sequence[int], facts: EvaluationFacts) -> ScopeName:
        """The name of what happens at `node` under these facts and attempt numbers."""
        turns = self.turns_at(node, facts)
        return ScopeName(facts.run, node, self.layout.subjects[node], tuple(attempts), turns)

    def current_scope(self, node: int, facts: EvaluationFacts) -> ScopeName:
        """The name under the attempt numbers that are facts now, whether or not it is reached."""
        attempts: list[int] = []
        for outer in self.layout.loops[node]:
            recorded = facts.attempt(str(self.scope(outer, attempts, facts)))
            limit = self.layout.limits[outer]
            attempts.append(recorded if limit < 0 else min(recorded, limit - 1))
        if self.layout.remembering[node] and attempts:
            text = memory_text(self.layout, node, ".".join(map(str, attempts)))
            attempts = [int(part) for part in text.split(".")]
        return self.scope(node, attempts, facts)

    def is_obsolete(self, name: ScopeName, facts: EvaluationFacts) -> bool:
        """Whether no evaluation, now or later, can reach this name any more.

        Turns only grow, and while they stand attempt numbers only grow (they begin again
        where a guard of the Retry has turned), so every replica comes to the same answer. A
        name that is ahead of these facts is not obsolete.
        """
        if name.run != facts.run or not 0 <= name.node < len(self.tree.nodes):
            return True
        current = self.current_scope(name.node, facts)
        if name.subject != current.subject or len(name.attempts) != len(current.attempts):
            return True
        return (name.turns, name.attempts) < (current.turns, current.attempts)

    def evaluate(self, facts: EvaluationFacts) -> Evaluation:
        """Tick the tree once."""
        layout = self.layout
        turned = [facts.turns(name, value) for name, value in layout.guards]
        tick = Tick(layout, self.functions, facts, turned)
        tick.tick(0, 0, "")
        is_live = tick.liveness()
        asking, watching = tick.asking, tick.watching
        if tick.hides:
            asking = [rank for rank in asking if is_live(layout.by_rank[rank])]
            watching = [rank for rank in watching if is_live(layout.by_rank[rank])]
        return self._evaluation(
            tick,
            tuple(self._request(tick, rank) for rank in asking),
            tuple(self._timeout(tick, rank) for rank in watching),
            tuple(tick.names[layout.by_rank[rank]] for rank in tick.failed),
        )

    def _evaluation(
        self,
        tick: Tick,
        requests: tuple[Request, ...],
        timeouts: tuple[RunningTimeout, ...],
        failures: tuple[str, ...],
    ) -> Evaluation:
        latches, kept = tick.said(0, self.layout.ends[0])
        passed = tick.passed(tick.liveness())
        return Evaluation(
            bytes(tick.statuses), requests, timeouts, tuple(latches), failures, (*passed, *kept)
        )

    def _request(self, tick: Tick, rank: int) -> Request:
        node = self.layout.by_rank[rank]
        return Request(node, self.layout.subjects[node], tick.names[node])

    def _timeout(self, tick: Tick, rank: int) -> RunningTimeout:
        node = self.layout.by_rank[rank]
        return RunningTimeout(node, tick.names[node], self.tree.nodes[node].timeout_us)
