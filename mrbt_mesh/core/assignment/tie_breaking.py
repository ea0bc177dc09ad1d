"""Among assignments that cost the same, the first one: robots in order, each as early as it can be.

A robot goes to an earlier node if others can make room for it in a circle of moves that cost
nothing; a breadth-first search over the nodes finds such a circle.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np

from mrbt_mesh.core.assignment.problem import Integers

# Where fewer robots can leave a node, it is worth while to look again where they can go.
_FEW = 8
# A search that has seen `_MANY` nodes is met from its end, by a step more each time that it has
# grown by `_GROWTH`.
_MANY = 16
_GROWTH = 4


def first_of_ties(
    choice: list[int], robots: Integers, nodes: Integers, more: list[int], less: list[int]
) -> list[int]:
    """The canonical choice, a node per robot, from any optimal one; that may be changed.

    `robots` and `nodes` are the tight options. `more` and `less` are how many robots more or less
    a node may have where that costs nothing.
    """
    several = np.bincount(robots, minlength=len(choice)) > 1
    free: list[int] = several.nonzero()[0].tolist()
    if not free:
        return choice
    if len(free) < len(choice):
        kept = several[robots]
        robots, nodes = robots[kept], nodes[kept]
    return _Ties(choice, free, robots, nodes, more, less).resolve()


class _Ties:
    """Fixes the robots that have several tight options, in order. Sets of nodes are bit masks.

    `through[u]` is the slack if that takes a robot of u, or nothing; `through[slack]` are the
    nodes which it can give one. `ahead[u]` adds the nodes to which some robot at u that is not
    fixed could move; it may still name one to which nobody can move any more. `cells` part the
    nodes: ways never lead back from one cell to another one that they have left.
    """

    def __init__(
        self,
        choice: list[int],
        free: list[int],
        robots: Integers,
        nodes: Integers,
        more: list[int],
        less: list[int],
    ) -> None:
        """`robots` and `nodes` are the tight options of those robots that are free to choose."""
        self._slack = slack = len(more)
        self._bits = bits = [1 << node for node in range(slack + 1)]
        self._tight = robots, nodes
        self._options = _masks(free, robots, nodes, slack)
        self._choice = choice
        _sorted_alike(self._choice, self._options)
        self._more, self._less = more, less
        self._through = [bits[slack] if count else 0 for count in more]
        self._through.append(sum(bit for bit, count in zip(bits, less, strict=False) if count))
        self._movable: list[list[int]] = [[] for _ in bits]
        self._ahead = self._through.copy()
        for robot, options in self._options.items():
            node = self._choice[robot]
            self._movable[node].append(robot)
            self._ahead[node] |= options
        self._cell = [0] * (slack + 1)
        self._cells = [(1 << (slack + 1)) - 1]
        self._parent = [0] * (slack + 1)

    def resolve(self) -> list[int]:
        bits, choice, movable, ahead = self._bits, self._choice, self._movable, self._ahead
        cell, cells, masks, through = self._cell, self._cells, self._options, self._through
        for robot, options in masks.items():
            here = choice[robot]
            goal = bits[here]
            if cells[cell[here]] == goal:
                continue
            leaving = movable[here]
            leaving.remove(robot)
            if len(leaving) < _FEW:
                mask = through[here]
                for mover in leaving:
                    mask |= masks[mover]
                ahead[here] = mask
            before = options & (goal - 1)
            while better := before & cells[cell[here]]:
                start = (better & -better).bit_length() - 1
                way = [here, start] if ahead[start] & goal else self._search(robot, start, here)
                if way and self._rotate(robot, way):
                    break
        return choice

    def _search(self, robot: int, start: int, end: int) -> list[int] | None:
        """The nodes of a way from `start` to `end` by robots after `robot`, the last one first.

        Breadth first. Where there is none, whatever `start` reaches becomes a cell of its own.
        """
        ahead, parent, goals = self._ahead, self._parent, self._bits[end]
        cell = self._cell[start]
        unseen = self._cells[cell] ^ self._bits[start]
        parent[start] = start
        queue, after = [start], {end: end}
        many, steps = _MANY, 0
        for node in queue:
            fresh = ahead[node] & unseen
            unseen ^= fresh
            while fresh:
                bit = fresh & -fresh
                fresh ^= bit
                seen = bit.bit_length() - 1
                parent[seen] = node
                if ahead[seen] & goals:
                    return self._joined(seen, goals, after)
                queue.append(seen)
            if len(queue) > many:
                many, steps = many * _GROWTH, steps + 1
                after, goals = self._before(robot, start, end, steps)
                for seen in queue:
                    if ahead[seen] & goals:
                        return self._joined(seen, goals, after)
        for node in queue:
            self._cell[node] = len(self._cells)
        self._cells.append(self._cells[cell] ^ unseen)
        self._cells[cell] = unseen
        return None

    def _joined(self, met: int, goals: int, after: dict[int, int]) -> list[int]:
        """The way to `met`, from where it was searched, on to a goal, and as that leads on."""
        goal = (self._ahead[met] & goals).bit_length() - 1
        way, parent = [goal], self._parent
        while (node := after[goal]) != goal:
            way.append(node)
            goal = node
        way.reverse()
        way.append(met)
        while (node := parent[met]) != met:
            way.append(node)
            met = node
        return way

    def _before(self, robot: int, start: int, end: int, steps: int) -> tuple[dict[int, int], int]:
        """The nodes from which robots after `robot` lead to `end` in `steps`, not by `start`.

        Each with the next one, and all as a mask.
        """
        after, layer = {start: start, end: end}, [end]
        for _ in range(steps):
            nodes, layer = layer, []
            for node in nodes:
                for mover in self._wanting(node):
                    here = self._choice[mover]
                    if mover > robot and here not in after:
                        after[here] = node
                        layer.append(here)
        del after[start]
        goals = 0
        for node in after:
            goals |= self._bits[node]
        return after, goals

    def _wanting(self, node: int) -> list[int]:
        """The robots of which it is an option."""
        robots, ends = self._by_node
        wanting: list[int] = robots[ends[node] : ends[node + 1]].tolist()
        return wanting

    @cached_property
    def _by_node(self) -> tuple[Integers, list[int]]:
        """The robots of all options, node by node, and where those of a node begin."""
        robots, nodes = self._tight
        counts = np.bincount(nodes, minlength=len(self._bits))
        small = nodes.astype(np.min_scalar_type(len(counts)))  # sorted faster
        return robots[small.argsort(kind="stable")], [0, *counts.cumsum().tolist()]

    def _rotate(self, robot: int, way: list[int]) -> bool:
        """Move a robot, now fixed, to where a way starts, and others along it to where it was.

        The way is given last node first. It is not gone if there is nobody to move from some
        node to the next: that is noted.
        """
        bits, options, movable, ahead = self._bits, self._options, self._movable, self._ahead
        movers = []
        for there, here in pairwise(way):
            bit = bits[there]
            if self._through[here] & bit:
                movers.append(-1)
                continue
            for mover in movable[here]:
                if options[mover] & bit:
                    movers.append(mover)
                    break
            else:
                ahead[here] &= ~bit
                return False
        self._choice[robot] = way[-1]
        for mover, there, here in zip(movers, way, way[1:], strict=False):
            if mover < 0:
                self._pass(here, there)
            else:
                movable[here].remove(mover)
                movable[there].append(mover)
                self._choice[mover] = there
                ahead[there] |= options[mover]
        for node in way:
            leaving = movable[node]
            if len(leaving) < _FEW:
                mask = self._through[node]
                for mover in leaving:
                    mask |= options[mover]
                ahead[node] = mask
        return True

    def _pass(self, here: int, there: int) -> None:
        """The slack takes a robot from one node, or gives one to the other."""
        slack = self._slack
        node, change = (here, 1) if there == slack else (there, -1)
        self._more[node] -= change
        self._less[node] += change
        self._through[node] = self._bits[slack] if self._more[node] else 0
        self._through[slack] &= ~self._bits[node]
        if self._less[node]:
            self._through[slack] |= self._bits[node]
        self._ahead[node] |= self._through[node]
        self._ahead[slack] |= self._through[slack]


def _masks(free: list[int], robots: Integers, nodes: Integers, count: int) -> dict[int, int]:
    """Per free robot its nodes, of `count`, as a mask."""
    width = -(-count // 64) * 64
    table = np.zeros((free[-1] + 1) * width, np.bool_)
    table[robots * width + nodes] = True
    packed = np.packbits(table, bitorder="little")
    if width == 64:
        return dict(zip(free, packed.view("<u8")[free].tolist(), strict=True))
    size, lines, convert = width // 8, packed.tobytes(), int.from_bytes
    return {robot: convert(lines[robot * size : (robot + 1) * size], "little") for robot in free}


def _sorted_alike(choice: list[int], options: dict[int, int]) -> None:
    """Robots with the same options exchange places, which costs nothing: the first the first.

    Where there are few such robots, ways are found as fast.
    """
    if 2 * len(set(options.values())) > len(options):
        return
    alike: dict[int, list[int]] = {}
    for robot, mask in options.items():
        alike.setdefault(mask, []).append(robot)
    for robots in alike.values():
        places = sorted([choice[robot] for robot in robots])
        for robot, place in zip(robots, places, strict=True):
            choice[robot] = place
