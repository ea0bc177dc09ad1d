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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from mrbt_mesh.core.evaluation import Evaluation, EvaluationFacts, Request, RunningTimeout
from mrbt_mesh.core.layout import Layout
from mrbt_mesh.core.tick import Functions, Tick, memory_text
from mrbt_mesh.core.tree import Tree

__all__ = [
    "Evaluation",
    "Evaluator",
    "Request",
    "RunningTimeout",
    "ScopeName",
    "parse_scope",
]


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


@lru_cache(maxsize=4_096)
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
        return evaluation_of(
            tick,
            is_live,
            tuple(request_of(tick, rank) for rank in asking),
            tuple(timeout_of(tick, rank) for rank in watching),
            tuple(failure_of(tick, rank) for rank in tick.failed),
        )


def evaluation_of(
    tick: Tick,
    is_live: Callable[[int], bool],
    requests: tuple[Request, ...],
    timeouts: tuple[RunningTimeout, ...],
    failures: tuple[str, ...],
) -> Evaluation:
    """What a tick has found, given what is asked for."""
    latches, kept = tick.said(0, tick.layout.ends[0])
    return Evaluation(
        bytes(tick.statuses),
        requests,
        timeouts,
        tuple(latches),
        failures,
        (*tick.passed(is_live), *kept),
    )


def request_of(tick: Tick, rank: int) -> Request:
    """What the action with this rank asks for."""
    node = tick.layout.by_rank[rank]
    name, known = tick.names[node], tick.asked[node]
    if known is None or known.activation is not name:
        known = tick.asked[node] = Request(node, tick.layout.subjects[node], name)
    return known


def timeout_of(tick: Tick, rank: int) -> RunningTimeout:
    """What the Timeout with this rank waits for."""
    node = tick.layout.by_rank[rank]
    name, known = tick.names[node], tick.watched[node]
    if known is None or known.scope is not name:
        timeout_us = tick.layout.tree.nodes[node].timeout_us
        known = tick.watched[node] = RunningTimeout(node, name, timeout_us)
    return known


def failure_of(tick: Tick, rank: int) -> str:
    """The activation of the action with this rank."""
    return tick.names[tick.layout.by_rank[rank]]
