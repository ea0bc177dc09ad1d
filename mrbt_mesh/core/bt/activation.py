"""Activations: to what outcomes, attempt numbers and memory belong.

Nodes remember nothing. What a memoryless tree would forget or repeat is decided by the *name* of an
activation, which follows from its causes alone: the run, the node, the attempt numbers of the
Retry and Repeat nodes around it, and how often its *guards* have turned against it. So it is the
same on every robot that has the same facts.

A guard of a node is a condition that every evaluation reads before it can reach the node, with the
value that keeps it from being reached. When such a condition turns to that value, the count grows
and the node has another activation: what was done there is done again. When it turns back, nothing
changes. What other nodes return has no part in the name, so a late outcome elsewhere cannot undo
what was done here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeAlias

from mrbt_mesh.core.bt.evaluation import EvaluationFacts
from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, Kind, Memory, Node, Status, Tree

# A condition, and the value at which what it guards cannot be reached.
Guard: TypeAlias = tuple[str, bool]


@dataclass(frozen=True, slots=True)
class Activation:
    """One activation of a node; its text is its name.

    `subject` is that of the node, empty for inner nodes. `attempts`: of the loops around it,
    outermost first. `turns`: how often its guards have turned against it, in all.
    """

    run: str
    node: int
    subject: str
    attempts: tuple[int, ...]
    turns: int

    def __str__(self) -> str:
        attempts = ".".join(map(str, self.attempts))
        return f"{self.run}:{self.node}:{self.subject}:{attempts}:{self.turns}"


@lru_cache(maxsize=4_096)
def parse_activation(text: str) -> Activation:
    """The inverse of `str(Activation)`; raises ValueError if it is none."""
    run, node, subject, attempts, turns = text.split(":")
    numbers = tuple(int(part) for part in attempts.split(".")) if attempts else ()
    return Activation(run, int(node), subject, numbers, int(turns))


class ActivationNames:
    """The activations of one tree's nodes; what it keeps follows from the tree alone."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree

    # -- the guards ---------------------------------------------------------------------------

    @cached_property
    def has_action(self) -> list[bool]:
        """By node: whether it or any below it is an action."""
        return self.tree.containing(Kind.ACTION)

    @cached_property
    def has_condition(self) -> list[bool]:
        """By node: whether it or any below it is a condition."""
        return self.tree.containing(Kind.CONDITION)

    @cached_property
    def has_memory(self) -> list[bool]:
        """By node: whether it does not tick children again that have ended.

        Above conditions alone memory makes no difference: such a node ends in the tick in which it
        begins.
        """
        return [
            node.memory is not Memory.NONE and self.has_action[node.index]
            for node in self.tree.nodes
        ]

    @cached_property
    def guards_of(self) -> list[tuple[Guard, ...]]:
        """By node: its guards. Those of its parent, then what its left siblings read.

        A guard counts once a level, but as often as one sibling reads it.
        """
        found: list[tuple[Guard, ...]] = [()] * len(self.tree.nodes)
        for node in self.tree.nodes:
            guards = found[node.index]
            for position, child in enumerate(node.children):
                fresh = () if self.has_memory[node.index] else self.read_before(node, position)
                guards = (*guards, *(guard for guard in fresh if guard not in guards))
                found[child] = guards
                if node.kind is Kind.IF_THEN_ELSE:
                    guards = found[node.index]
        return found

    def read_before(self, node: Node, position: int) -> tuple[Guard, ...]:
        """The guards that the left sibling of a child reads, with the values against the child.

        In a Sequence a sibling must succeed for the child to be reached, in a Fallback it must
        fail, in an IfThenElse the first child decides. Children of a Parallel do not guard one
        another.
        """
        if position == 0:
            return ()
        left = node.children[position - 1]
        match node.kind:
            case Kind.SEQUENCE:
                return self._read(left, Status.SUCCESS)
            case Kind.FALLBACK:
                return self._read(left, Status.FAILURE)
            case Kind.IF_THEN_ELSE:
                wanted = Status.SUCCESS if position == 1 else Status.FAILURE
                return self._read(node.children[0], wanted)
        return ()

    def _read(self, index: int, wanted: Status) -> tuple[Guard, ...]:
        """The guards that every evaluation reads at or below a node.

        `wanted` is the status that the node must have for its right siblings to be reached. A
        Sequence in a Sequence counts as if its children stood in the outer one, and so does a
        Fallback in a Fallback. What is read below an IfThenElse or a node with memory depends on
        more than the present conditions.
        """
        node = self.tree.nodes[index]
        succeed = wanted is Status.SUCCESS
        if self.has_memory[index] or not self.has_condition[index]:
            return ()
        children = node.children
        match node.kind:
            case Kind.CONDITION:
                return ((node.subject, not succeed),)
            case Kind.INVERTER:
                wanted = Status.FAILURE if succeed else Status.SUCCESS
            case Kind.FORCE_SUCCESS | Kind.FORCE_FAILURE | Kind.ACTION | Kind.IF_THEN_ELSE:
                return ()
            case Kind.SEQUENCE:
                children = children if succeed else children[:1]
            case Kind.FALLBACK:
                children = children[:1] if succeed else children
        return tuple(guard for child in children for guard in self._read(child, wanted))

    def turns_at(self, node: int, facts: EvaluationFacts) -> int:
        """How often the guards of a node have turned against it, in all."""
        return sum(facts.turns(name, value) for name, value in self.guards_of[node])

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
        subject = self.tree.nodes[node].subject
        return Activation(facts.run, node, subject, tuple(attempts), self.turns_at(node, facts))

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

    def current_activation(self, node: int, facts: EvaluationFacts) -> Activation:
        """The activation under the attempt numbers that are facts now, reached or not."""
        attempts: list[int] = []
        for loop in self.enclosing_loops[node]:
            recorded = facts.attempts_used(str(self.activation(loop, attempts, facts)))
            attempts.append(self.current_attempt(loop, recorded))
        if self.has_memory[node]:
            return self.memory_activation(node, attempts, facts)
        return self.activation(node, attempts, facts)

    def is_obsolete(self, activation: Activation, facts: EvaluationFacts) -> bool:
        """Whether no evaluation, now or later, can reach this activation any more.

        Turns only grow. While they stay, attempt numbers only grow (they begin again where a guard
        of the loop has turned). So every replica comes to the same answer. An activation that is
        ahead of these facts is not obsolete.
        """
        if activation.run != facts.run or not 0 <= activation.node < len(self.tree.nodes):
            return True
        current = self.current_activation(activation.node, facts)
        if activation.subject != current.subject or len(activation.attempts) != len(
            current.attempts
        ):
            return True
        return (activation.turns, activation.attempts) < (current.turns, current.attempts)
