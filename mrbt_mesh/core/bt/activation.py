"""Names of activations: to what an outcome belongs.

No node remembers anything. What a memoryless tree would forget or repeat is decided by the name
of an *activation*: the run, the leaf, the attempt numbers of the enclosing Retry and Repeat nodes,
and how often the leaf's guards have turned against it. Same facts, same name, on every robot. A
guard that flipped and flipped back gives a new name, so the work is done again.

Attempt counters, expired Timeouts and what nodes with memory remember have names of the same form
(*scopes*).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

from mrbt_mesh.core.bt.evaluation import EvaluationFacts
from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, Kind, Memory, Node, Status, Tree

# A condition, and the value that turns against what it guards.
Guard = tuple[str, bool]


@dataclass(frozen=True, slots=True)
class Activation:
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
def parse_activation(text: str) -> Activation:
    """The inverse of `str(ScopeName)`; raises ValueError if it is none."""
    run, node, subject, attempts, turns = text.split(":")
    numbers = tuple(int(part) for part in attempts.split(".")) if attempts else ()
    return Activation(run, int(node), subject, numbers, int(turns))


class ActivationNames:
    """The names of what happens in one tree; what it keeps follows from the tree alone."""

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
    def remembering(self) -> list[bool]:
        """By node: whether it does not look again at children that have ended.

        Where there are only conditions, a node ends in the tick in which it begins.
        """
        return [
            node.memory is not Memory.NONE and self.has_action[node.index]
            for node in self.tree.nodes
        ]

    @cached_property
    def guards(self) -> list[tuple[Guard, ...]]:
        """By node: the conditions that every evaluation reads before it can reach the node.

        Those of its parent, then at each level those of its left siblings. A guard counts once a
        level, but as often as one sibling reads it.
        """
        found: list[tuple[Guard, ...]] = [()] * len(self.tree.nodes)
        for node in self.tree.nodes:
            guards = found[node.index]
            for position, child in enumerate(node.children):
                fresh = () if self.remembering[node.index] else self.read_before(node, position)
                guards = (*guards, *(guard for guard in fresh if guard not in guards))
                found[child] = guards
                if node.kind is Kind.IF_THEN_ELSE:
                    guards = found[node.index]
        return found

    def read_before(self, node: Node, position: int) -> tuple[Guard, ...]:
        """What the left sibling of a child reads that may turn against the child."""
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
        return ()  # children of a Parallel do not guard one another

    def _read(self, index: int, wanted: Status) -> tuple[Guard, ...]:
        """Conditions that every evaluation reads below `index`, with the value that turns against.

        `wanted` is the status that the node must keep for its right siblings to be reached. A
        composite of the same kind as its parent counts as written out in the parent. What is read
        below an IfThenElse or a remembering node depends on more than the present conditions.
        """
        node = self.tree.nodes[index]
        succeed = wanted is Status.SUCCESS
        if self.remembering[index] or not self.has_condition[index]:
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
        return sum(facts.turns(name, value) for name, value in self.guards[node])

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

    def attempt(self, node: int, recorded: int) -> int:
        """The attempt that is on, given the recorded number: never beyond the last one."""
        limit = self.limit(node)
        return recorded if limit < 0 else min(recorded, limit - 1)

    # -- the names ----------------------------------------------------------------------------

    def activation(self, node: int, attempts: Sequence[int], facts: EvaluationFacts) -> Activation:
        """The name of what happens at `node` under these facts and attempt numbers."""
        subject = self.tree.nodes[node].subject
        return Activation(facts.run, node, subject, tuple(attempts), self.turns_at(node, facts))

    def memory_activation(
        self, node: int, attempts: Sequence[int], facts: EvaluationFacts
    ) -> Activation:
        """The name under which a node with memory remembers.

        A Retry changes nothing for one that remembers until it succeeds.
        """
        if self.tree.nodes[node].memory is Memory.UNTIL_SUCCESS:
            outer = zip(self.enclosing_loops[node], attempts, strict=True)
            nodes = self.tree.nodes
            attempts = [0 if nodes[loop].kind is Kind.RETRY else number for loop, number in outer]
        return self.activation(node, attempts, facts)

    def current_activation(self, node: int, facts: EvaluationFacts) -> Activation:
        """The name under the attempt numbers that are facts now, whether or not it is reached."""
        attempts: list[int] = []
        for loop in self.enclosing_loops[node]:
            recorded = facts.attempts_used(str(self.activation(loop, attempts, facts)))
            attempts.append(self.attempt(loop, recorded))
        if self.remembering[node]:
            return self.memory_activation(node, attempts, facts)
        return self.activation(node, attempts, facts)

    def is_obsolete(self, name: Activation, facts: EvaluationFacts) -> bool:
        """Whether no evaluation, now or later, can reach this name any more.

        Turns only grow, and while they stand attempt numbers only grow (they begin again where a
        guard of the Retry has turned), so every replica comes to the same answer. A name that is
        ahead of these facts is not obsolete.
        """
        if name.run != facts.run or not 0 <= name.node < len(self.tree.nodes):
            return True
        current = self.current_activation(name.node, facts)
        if name.subject != current.subject or len(name.attempts) != len(current.attempts):
            return True
        return (name.turns, name.attempts) < (current.turns, current.attempts)
