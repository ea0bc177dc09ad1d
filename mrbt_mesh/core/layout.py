"""What follows from a tree alone, as flat lists by node index, for those that evaluate it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mrbt_mesh.core.tree import ATTEMPT_KINDS, Kind, Memory, Node, Status, Tree

# A condition, and the value that turns against what it guards.
Guard = tuple[str, bool]


class Layout:
    """Flat lists by node index.

    `ends`: the last index of the subtree. `ranks`: the place in postorder; a subtree takes those
    from `firsts` to its own. `loops`: the Retry and Repeat nodes around a node, outermost first.
    `fresh`: the guards that a child has besides those of its left sibling, or of its parent, as
    positions in `guards`; `entries` the other way round: where a guard comes in. A guard is named
    as often as it counts: twice if the left sibling reads the condition twice.
    """

    def __init__(self, tree: Tree) -> None:
        nodes = tree.nodes
        count = len(nodes)
        self.tree = tree
        self.kinds = [node.kind for node in nodes]
        self.subjects = [node.subject for node in nodes]
        self.parents = [node.parent for node in nodes]
        self.children = [node.children for node in nodes]
        self.positions = [0] * count
        self.ends = [0] * count
        self.has_action = tree.containing(Kind.ACTION)
        self.has_condition = tree.containing(Kind.CONDITION)
        for node in reversed(nodes):
            self.ends[node.index] = self.ends[node.children[-1]] if node.children else node.index
            for position, child in enumerate(node.children):
                self.positions[child] = position
        self._measure(nodes)
        # How many attempts or cycles a Retry or Repeat has, -1: no limit; M of a Parallel.
        self.limits = [
            -1 if node.kind is Kind.KEEP_RUNNING_UNTIL_FAILURE else node.limit for node in nodes
        ]
        # Where there are only conditions, a node ends in the tick in which it begins.
        self.remembering = [
            node.memory is not Memory.NONE and self.has_action[node.index] for node in nodes
        ]
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
        self._guard(0, set())
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
        self.loops: list[tuple[int, ...]] = [()] * count
        self.firsts, self.ranks, self.by_rank = [0] * count, [0] * count, [0] * count
        depths = [0] * count
        for node in nodes:
            index, parent = node.index, node.parent
            if parent >= 0:
                depths[index] = depths[parent] + 1
                own = (parent,) if nodes[parent].kind in ATTEMPT_KINDS else ()
                self.loops[index] = (*self.loops[parent], *own) if own else self.loops[parent]
            self.firsts[index] = index - depths[index]
            self.ranks[index] = self.ends[index] - depths[index]
            self.by_rank[self.ranks[index]] = index

    def _guard(self, index: int, active: set[Guard]) -> None:
        """Note the guards of everything below a node whose own guards are `active`."""
        node = self.tree.nodes[index]
        added: list[Guard] = []
        for position, child in enumerate(node.children):
            before = () if self.remembering[index] else self._before(node, position)
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
            self._guard(child, active)
            if node.kind is Kind.IF_THEN_ELSE:
                active.difference_update(added)
                added.clear()
        active.difference_update(added)

    def _before(self, node: Node, position: int) -> Sequence[Guard]:
        """What the left sibling of a child reads that may turn against the child."""
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
        found: list[Guard] = []
        self._against(before, wanted, found)
        return found

    def _against(self, index: int, wanted: Status, found: list[Guard]) -> None:
        """Conditions that every evaluation reads below `index`, with the value that turns against
        it.

        `wanted` is the status that the node must keep for its right siblings to be reached. A
        composite of the same kind as its parent counts as written out in the parent. What is
        read below an IfThenElse or a remembering node depends on more than the present conditions.
        """
        node = self.tree.nodes[index]
        succeed = wanted is Status.SUCCESS
        if self.remembering[index] or not self.has_condition[index]:
            return
        children = node.children
        match node.kind:
            case Kind.CONDITION:
                found.append((node.subject, not succeed))
            case Kind.INVERTER:
                wanted = Status.FAILURE if succeed else Status.SUCCESS
            case Kind.FORCE_SUCCESS | Kind.FORCE_FAILURE | Kind.IF_THEN_ELSE:
                return
            case Kind.SEQUENCE:
                children = children if succeed else children[:1]
            case Kind.FALLBACK:
                children = children[:1] if succeed else children
        for child in children:
            self._against(child, wanted, found)

    def guards_at(self, index: int) -> Iterable[int]:
        """All guards of a node, as often as they count."""
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


class TurnSums:
    """For every node, how often its guards have turned against it in all.

    A Fenwick tree over the nodes: a turn, or a question, takes as many steps as the number of
    nodes has binary digits. `turned` has the turns of each guard of the layout.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._sums = [0] * (len(layout.parents) + 2)
        self.turned = [0] * len(layout.guards)

    def set(self, guard: int, turns: int) -> bool:
        """Take in the turns of a guard; returns whether they have changed."""
        more = turns - self.turned[guard]
        if more:
            self.turned[guard] = turns
            for entry in self._layout.entries[guard]:
                first, last = self._layout.reach(entry)
                self._add(first, more)
                self._add(last + 1, -more)
        return bool(more)

    def _add(self, index: int, more: int) -> None:
        index += 1
        while index < len(self._sums):
            self._sums[index] += more
            index += index & -index

    def at(self, node: int) -> int:
        """The sum over the guards of a node."""
        total, index = 0, node + 1
        while index:
            total += self._sums[index]
            index &= index - 1
        return total
