"""Guards: the conditions that decide whether a node can be reached.

A *guard* of a node is an expression of conditions that every evaluation reads before it can reach
the node, with the value that keeps it from being reached. When the expression turns to that value,
the node gets another activation (`activation`): what was done there is done again. When it turns
back, nothing changes.

An *expression* is a subtree without actions, or the first children of a control if they have none.
A single condition needs no more than its name: its changes count its turns. The turns of several
conditions that decide together cannot be counted from theirs, since they may change at once; they
are a fact of their own (`facts.conditions`).

Where actions precede conditions in a guard, its status depends on the outcomes of the actions. Such
a guard turns when conditions take away the status that it must have, with the same outcomes
(`Evaluator.has_turned`). That is a fact as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

from mrbt_mesh.core.bt.tree import Kind, Memory, Node, NodeSpec, Status, Tree

# A condition's name or an expression's id, and the value at which it keeps its node out of reach.
Guard: TypeAlias = tuple[str, bool]

_FORCES = frozenset({Kind.FORCE_SUCCESS, Kind.FORCE_FAILURE})
_IN_ORDER = frozenset({Kind.SEQUENCE, Kind.FALLBACK})


@dataclass(frozen=True, slots=True)
class Expression:
    """Several conditions that decide together; its value is whether `spec` succeeds.

    `id`: `#7` for the subtree at the node with the key 7, `#7:2` for its first two children.
    `conditions`: the names that it reads, sorted.
    """

    id: str
    spec: NodeSpec
    conditions: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GuardWithActions:
    """Conditions and actions that decide together: the subtree at `node` must return `wanted`.

    `id`: `#7:success` or `#7:failure`. As a guard it has the value True when the status is another
    one. `conditions`: the names that it reads, sorted.
    """

    id: str
    node: int
    wanted: Status
    conditions: tuple[str, ...]


class Guards:
    """The guards of one tree's nodes; its caches follow from the tree alone."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self._expressions: dict[str, Expression] = {}
        self._with_actions: dict[str, GuardWithActions] = {}

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
        """By node: its guards, each once. Those of its parent, then what its left siblings read.

        Of conditions none: they have no activation, and one node may have thousands of them.
        """
        found: list[tuple[Guard, ...]] = [()] * len(self.tree.nodes)
        for node in self.tree.nodes:
            guards = dict.fromkeys(found[node.index])
            for position, child in enumerate(node.children):
                guards |= dict.fromkeys(self.read_before(node, position))
                if self.tree.nodes[child].kind is not Kind.CONDITION:
                    found[child] = tuple(guards)
                if node.kind is Kind.IF_THEN_ELSE:
                    guards = dict.fromkeys(found[node.index])
        return found

    @cached_property
    def expressions(self) -> dict[str, Expression]:
        """The expressions among all guards, by id; conditions alone are none."""
        self._read_all()
        return self._expressions

    @cached_property
    def with_actions(self) -> dict[str, GuardWithActions]:
        """The guards with actions, by id; those inside others come first."""
        self._read_all()
        found = self._with_actions.values()
        return {each.id: each for each in sorted(found, key=lambda each: (-each.node, each.id))}

    def _read_all(self) -> None:
        for node in self.tree.nodes:
            for position in range(1, len(node.children)):
                self.read_before(node, position)

    def read_before(self, node: Node, position: int) -> tuple[Guard, ...]:
        """The guards that the left sibling of a child reads, with the values against the child.

        In a Sequence a sibling must succeed for the child to be reached, in a Fallback it must
        fail, in an IfThenElse the first child decides. Children of a Parallel do not guard one
        another, nor do those of a node with memory, which does not look at them again.
        """
        if position == 0 or self.has_memory[node.index]:
            return ()
        left, wanted = node.children[position - 1], Status.SUCCESS
        match node.kind:
            case Kind.SEQUENCE:
                pass
            case Kind.FALLBACK:
                wanted = Status.FAILURE
            case Kind.IF_THEN_ELSE:
                left = node.children[0]
                wanted = Status.SUCCESS if position == 1 else Status.FAILURE
            case _:
                return ()
        return tuple(dict.fromkeys(self._read(left, wanted)))

    def _read(self, index: int, wanted: Status) -> Iterator[Guard]:
        """The guards that are read at or below a node.

        `wanted` is the status that the node must have for its right siblings to be reached. A node
        with memory does not look at its conditions again.
        """
        node = self.tree.nodes[index]
        if self.has_memory[index] or not self.has_condition[index]:
            return
        if not self.has_action[index]:
            yield from self._of_conditions(index, wanted, is_needed=True)
            return
        if node.kind is Kind.INVERTER:
            wanted = _opposite(wanted)
        count = self._leading_conditions(node)
        if needs_all(node, wanted):
            for child in node.children:
                yield from self._read(child, wanted)
        elif count == 0:
            yield self._guard_with_actions(node, wanted), True
        elif count > 1:
            yield self._expression(node, count), wanted is not Status.SUCCESS
        else:
            yield from self._of_conditions(node.children[0], wanted, is_needed=False)

    def _of_conditions(self, index: int, wanted: Status, is_needed: bool) -> Iterator[Guard]:
        """The guards of a subtree without actions.

        Where all its children are needed they count one by one: once one has turned, nothing
        behind is reached until all have turned back.
        """
        node = self.tree.nodes[index]
        if node.kind is Kind.CONDITION:
            yield node.subject, wanted is not Status.SUCCESS
        elif node.kind in _FORCES:
            return
        elif len(node.children) == 1 or (is_needed and needs_all(node, wanted)):
            if node.kind is Kind.INVERTER:
                wanted = _opposite(wanted)
            for child in node.children:
                yield from self._of_conditions(child, wanted, is_needed)
        else:
            yield self._expression(node, 0), wanted is not Status.SUCCESS

    def _leading_conditions(self, node: Node) -> int:
        """How many of the first children have no actions, where all conditions are in these.

        0 where there are conditions elsewhere, or where another rule than that of a Sequence or
        Fallback decides.
        """
        count = [self.has_action[child] for child in node.children].index(True)
        rest = node.children[count:]
        if node.kind not in _IN_ORDER or any(self.has_condition[child] for child in rest):
            return 0
        return count

    def _guard_with_actions(self, node: Node, wanted: Status) -> str:
        name = f"#{node.key}:{wanted.name.lower()}"
        conditions = tuple(sorted(conditions_in(self.tree.spec(node.index))))
        self._with_actions[name] = GuardWithActions(name, node.index, wanted, conditions)
        return name

    def _expression(self, node: Node, count: int) -> str:
        """The id of the subtree at a node, or of its first children."""
        name = f"#{node.key}:{count}" if count else f"#{node.key}"
        if name not in self._expressions:
            spec = self.tree.spec(node.index)
            if count:
                spec = NodeSpec(node.kind, spec.children[:count])
            self._expressions[name] = Expression(name, spec, tuple(sorted(conditions_in(spec))))
        return name


def needs_all(node: Node, wanted: Status) -> bool:
    """Whether all children of a node must have the wanted status for the node to have it.

    Of an Inverter, and others with one child, that status is the child's own.
    """
    match node.kind:
        case Kind.SEQUENCE:
            return wanted is Status.SUCCESS
        case Kind.FALLBACK:
            return wanted is Status.FAILURE
        case Kind.PARALLEL if wanted is Status.SUCCESS:
            return node.limit == len(node.children)
        case Kind.PARALLEL:
            return node.limit == 1 and node.failures in (0, len(node.children))
        case Kind.IF_THEN_ELSE | Kind.FORCE_SUCCESS | Kind.FORCE_FAILURE | Kind.JOBS:
            return False
    return True


def conditions_in(spec: NodeSpec) -> set[str]:
    """The names of the conditions in a tree."""
    if spec.kind is Kind.CONDITION:
        return {spec.subject}
    return {name for child in spec.children for name in conditions_in(child)}


def _opposite(status: Status) -> Status:
    return Status.FAILURE if status is Status.SUCCESS else Status.SUCCESS
