"""How often the guards of each node have turned, kept up to date."""

from __future__ import annotations

from mrbt_mesh.core.incremental.evaluation.compiled_tree import CompiledTree


class TurnSums:
    """For every node, how often its guards have turned against it in all.

    A Fenwick tree over the nodes: a turn, or a question, takes O(log n) steps. `turned` has the
    turns of each guard of the layout.
    """

    def __init__(self, layout: CompiledTree) -> None:
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
