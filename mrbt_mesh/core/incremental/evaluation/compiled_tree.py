"""What follows from a tree alone, as flat lists by node index, for those that evaluate it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mrbt_mesh.core.bt.activation import ActivationNames
from mrbt_mesh.core.bt.guards import Guard
from mrbt_mesh.core.bt.tree import Kind, Memory, Node


class CompiledTree:
    """Flat lists by node index.

    `ends`: the last index of the subtree. `ranks`: the place in postorder; a subtree takes those
    from `firsts` to its own. `fresh`: the guards that a child has besides those of its left
    sibling, or of its parent, as positions in `guards`; `entries` the other way round: where a
    guard comes in.
    """

    def __init__(self, names: ActivationNames) -> None:
        tree = names.tree
        nodes = tree.nodes
        count = len(nodes)
        self.tree = tree
        self.kinds = [node.kind for node in nodes]
        self.subjects = [node.subject for node in nodes]
        self.parents = [node.parent for node in nodes]
        self.children = [node.children for node in nodes]
        self.positions = [0] * count
        self.ends = [0] * count
        self.has_action, self.has_condition = names.has_action, names.has_condition
        self.remembering, self.loops = names.has_memory, names.enclosing_loops
        for node in reversed(nodes):
            self.ends[node.index] = self.ends[node.children[-1]] if node.children else node.index
            for position, child in enumerate(node.children):
                self.positions[child] = position
        self._measure(nodes)
        # How many attempts or cycles a Retry or Repeat has, -1: no limit; M of a Parallel.
        self.limits = [names.limit(node.index) for node in nodes]
        # Children whose end a node with memory must be told of: without a condition or another
        # attempt, one would end the same way again.
        self.recalled = [
            node.parent >= 0
            and self.remembering[node.parent]
            and (self.has_condition[node.index] or self.keeps(node.parent))
            for node in nodes
        ]
        self.guards: list[Guard] = []
        self.fresh: list[tuple[int, ...]] = [()] * count
        self.entries: list[list[int]] = []
        self._numbers: dict[Guard, int] = {}
        self._guard(names, 0, set())
        self.guards_of: dict[str, list[int]] = {}
        for number, (name, _) in enumerate(self.guards):
            self.guards_of.setdefault(name, []).append(number)
        self.readers: dict[str, list[int]] = {}
        for node in nodes:
            if node.kind is Kind.CONDITION:
                self.readers.setdefault(node.subject, []).append(node.index)

    def keeps(self, node: int) -> bool:
        """Whether a failure does not make this node forget."""
        return self.tree.nodes[node].memory is Memory.UNTIL_SUCCESS

    def _measure(self, nodes: Sequence[Node]) -> None:
        count = len(nodes)
        self.firsts, self.ranks, self.by_rank = [0] * count, [0] * count, [0] * count
        depths = [0] * count
        for node in nodes:
            index, parent = node.index, node.parent
            if parent >= 0:
                depths[index] = depths[parent] + 1
            self.firsts[index] = index - depths[index]
            self.ranks[index] = self.ends[index] - depths[index]
            self.by_rank[self.ranks[index]] = index

    def _guard(self, names: ActivationNames, index: int, active: set[Guard]) -> None:
        """Note the guards of everything below a node whose own guards are `active`."""
        node = self.tree.nodes[index]
        added: list[Guard] = []
        for position, child in enumerate(node.children):
            before = names.read_before(node, position)
            fresh = [guard for guard in before if guard not in active]
            for guard in fresh:
                if guard not in self._numbers:
                    self._numbers[guard] = len(self.guards)
                    self.guards.append(guard)
                    self.entries.append([])
                self.entries[self._numbers[guard]].append(child)
            if fresh:
                self.fresh[child] = tuple(self._numbers[guard] for guard in fresh)
                active.update(fresh)
                added += fresh
            self._guard(names, child, active)
            if node.kind is Kind.IF_THEN_ELSE:
                active.difference_update(added)
                added.clear()
        active.difference_update(added)

    def guards_at(self, index: int) -> Iterable[int]:
        """All guards of a node."""
        while index > 0:
            parent = self.parents[index]
            yield from self.fresh[index]
            if self.kinds[parent] in (Kind.SEQUENCE, Kind.FALLBACK):
                for sibling in self.children[parent][: self.positions[index]]:
                    yield from self.fresh[sibling]
            index = parent

    def reach(self, entry: int) -> tuple[int, int]:
        """The first and last index of what is guarded by a guard that comes in at this node."""
        parent = self.parents[entry]
        last = entry if self.kinds[parent] is Kind.IF_THEN_ELSE else parent
        return entry, self.ends[last]

    def turned_reach(self, name: str, value: bool) -> list[tuple[int, int]]:
        """The first and last indices of what is guarded against this condition's `value`."""
        number = self._numbers.get((name, value))
        return [] if number is None else [self.reach(entry) for entry in self.entries[number]]
