"""Activations: outcomes, attempt numbers and memory belong to them.

Nodes remember nothing. The *name* of an activation decides what a memoryless tree would forget or
repeat. It follows from its causes alone: the run, the node, the attempt numbers of the
Retry and Repeat nodes around it, and how often its *guards* have turned against it. So it is the
same on every robot that has the same facts.

A guard of a node is an expression of conditions that every evaluation reads before it can reach the
node (`guards`). When it turns against the node, the count grows and the node has another
activation: what was done there is done again. What other nodes return has no part in the name, so a
late outcome elsewhere cannot undo what was done here.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple

from mrbt_mesh.core.bt.evaluation import EvaluationFacts
from mrbt_mesh.core.bt.guards import Guards
from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, Kind, Memory


class Activation(NamedTuple):
    """One activation of a node; its text is its name.

    `node` and `job` are the node's `number` and `job`. `subject` is that of the node, empty for
    inner nodes. `attempts`: of the loops around it, outermost first. `turns`: how often its guards
    have turned against it, in all.
    """

    run: str
    node: int
    subject: str
    attempts: tuple[int, ...]
    turns: int
    job: str = ""

    def __str__(self) -> str:
        attempts = ".".join(map(str, self.attempts))
        node = f"{self.node}@{self.job}" if self.job else self.node
        return f"{self.run}:{node}:{self.subject}:{attempts}:{self.turns}"


@lru_cache(maxsize=4_096)
def parse_activation(text: str) -> Activation:
    """The inverse of `str(Activation)`; raises ValueError if it is none."""
    run, key, subject, attempts, turns = text.split(":")
    node, _, job = key.partition("@")
    numbers = tuple(int(part) for part in attempts.split(".")) if attempts else ()
    return Activation(run, int(node), subject, numbers, int(turns), job)


class ActivationNames(Guards):
    """The activations of one tree's nodes; its caches follow from the tree alone."""

    def turns_at(self, node: int, facts: EvaluationFacts) -> int:
        """How often the guards of a node have turned against it, in all."""
        turns = 0
        for name, value in self.guards_of[node]:
            turns += facts.turns(name, value)
        return turns

    # -- the attempts -------------------------------------------------------------------------

    @cached_property
    def enclosing_loops(self) -> list[tuple[int, ...]]:
        """By node: the Retry and Repeat nodes around it, outermost first."""
        found: list[tuple[int, ...]] = [()] * len(self.tree.nodes)
        for node in self.tree.nodes:
            own = (node.index,) if node.kind in ATTEMPT_KINDS else ()
            for child in node.children:
                found[child] = (*found[node.index], *own) if own else found[node.index]
        return found

    def limit(self, node: int) -> int:
        """How many attempts or cycles a Retry or Repeat has, -1: no limit."""
        loop = self.tree.nodes[node]
        return -1 if loop.kind is Kind.KEEP_RUNNING_UNTIL_FAILURE else loop.limit

    def current_attempt(self, node: int, used: int) -> int:
        """The number of the present attempt, given how many are used up: never beyond the last."""
        limit = self.limit(node)
        return used if limit < 0 else min(used, limit - 1)

    # -- activations --------------------------------------------------------------------------

    def activation(self, node: int, attempts: Sequence[int], facts: EvaluationFacts) -> Activation:
        """The activation of `node` under these facts and attempt numbers."""
        at, turns = self.tree.nodes[node], self.turns_at(node, facts)
        return Activation(facts.run, at.number, at.subject, tuple(attempts), turns, at.job)

    @cached_property
    def index_of(self) -> dict[tuple[int, str], int]:
        """(number, job) of each node -> its index."""
        return {(node.number, node.job): node.index for node in self.tree.nodes}

    def memory_activation(
        self, node: int, attempts: Sequence[int], facts: EvaluationFacts
    ) -> Activation:
        """The activation to which the memory of a node belongs.

        A Retry around it changes nothing for one that remembers until it succeeds.
        """
        if self.tree.nodes[node].memory is Memory.UNTIL_SUCCESS:
            outer = zip(self.enclosing_loops[node], attempts, strict=True)
            nodes = self.tree.nodes
            attempts = [0 if nodes[loop].kind is Kind.RETRY else number for loop, number in outer]
        return self.activation(node, attempts, facts)

    def current_attempts(self, node: int, facts: EvaluationFacts) -> list[int]:
        """The attempt numbers of the loops around a node that are facts now."""
        attempts: list[int] = []
        for loop in self.enclosing_loops[node]:
            recorded = facts.attempts_used(str(self.activation(loop, attempts, facts)))
            attempts.append(self.current_attempt(loop, recorded))
        return attempts

    def current_activation(self, node: int, facts: EvaluationFacts) -> Activation:
        """The activation under the attempt numbers that are facts now, reached or not."""
        attempts = self.current_attempts(node, facts)
        if self.has_memory[node]:
            return self.memory_activation(node, attempts, facts)
        return self.activation(node, attempts, facts)

    def is_obsolete(self, activation: Activation, facts: EvaluationFacts) -> bool:
        """Whether no evaluation, now or later, can reach this activation any more.

        Turns only grow. While they stay, attempt numbers only grow (they begin again where a guard
        of the loop has turned). So every replica comes to the same answer. An activation that is
        ahead of these facts is not obsolete, nor is one of a job that is not in the tree.
        """
        index = self.index_of.get((activation.node, activation.job))
        if activation.run != facts.run or index is None:
            return not activation.job
        current = self.current_activation(index, facts)
        if activation.subject != current.subject or len(activation.attempts) != len(
            current.attempts
        ):
            return True
        return (activation.turns, activation.attempts) < (current.turns, current.attempts)
