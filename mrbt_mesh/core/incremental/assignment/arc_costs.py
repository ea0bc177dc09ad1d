"""Which robot can do what, and what it would cost to move it: one step of a shortest path.

Robots and nodes are small integers; node `IDLE` is what everybody can do for nothing. Two ways to
store the same: dictionaries, where few robots can do a demand, and a matrix, where most can.

The level of a robot is its performance where it is, minus the price of that node. Moving it to
another node costs level - (performance there - price there), which is never negative at an optimum.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

IDLE = 0
ENTRY = 1  # where robots are that have no place yet
NEAR, FAR = 0, 1  # the two ends of a search
# Beyond every distance, and a performance below all: sums of some of them fit 64 bits.
UNREACHED = 1 << 60
CANNOT = -(1 << 61)
# Prices and distances stay below this as long as performance times nodes does.
MAX_DISTANCE = 1 << 57

Row: TypeAlias = Mapping[int, int]
Integers: TypeAlias = NDArray[np.int64]


class Options(Protocol):
    """`level` and `price` are kept here, next to the performances that they are compared with."""

    def set_robot(self, robot: int, row: Row) -> None:
        """A robot with these performances, by node; it is nowhere yet."""

    def drop_robot(self, robot: int) -> None:
        """The robot can do nothing any more, not even be idle; its number may be given again."""

    def set_column(self, node: int, column: Row) -> None:
        """A node with these performances, by robot."""

    def performance(self, robot: int, node: int) -> int | None:
        """None: cannot."""

    def row(self, robot: int) -> dict[int, int]:
        """What the robot can do, without being idle."""

    def highest_offer(self, node: int) -> int | None:
        """The price from which on no robot would move to the node; None: nobody can."""

    def is_content(self, robot: int) -> bool:
        """Whether no move of the robot costs less than nothing."""

    def put(self, robot: int, node: int) -> None:
        """The robot is on this node now, which it can do."""

    def lift(self, robot: int) -> None:
        """The robot is at `ENTRY` now, at such a level that its cheapest move costs nothing."""

    def level(self, robot: int) -> int: ...

    def price(self, node: int) -> int: ...

    def prices(self) -> Sequence[int]:
        """By node."""

    def reprice(self, node: int, price: int, robots: Iterable[int]) -> None:
        """Set the price of a node; `robots` are those on it."""

    def begin(self, side: int) -> None:
        """A search begins: nothing has been reached from that side."""

    def into(self, side: int, node: int, base: int, limit: int) -> Iterable[tuple[int, int]]:
        """(other node, base + cost of moving a robot from there to `node`), up to `limit`.

        May leave out what is no cheaper than something given before on that side for the same
        other node.
        """

    def out_of(
        self, side: int, node: int, robots: Iterable[int], base: int, limit: int
    ) -> Iterable[tuple[int, int]]:
        """(other node, base + cost of moving one of `robots`, those on `node`, there); likewise."""

    def mover(self, robots: Iterable[int], node: int) -> int:
        """The robot that moves to the node at the least cost."""

    def tight(self) -> tuple[Integers, Integers]:
        """(robot, node) of all moves that cost nothing, and where the robots are."""

    def moves(self, place: Integers) -> tuple[Integers, Integers, Integers]:
        """(robot, node, cost at equal prices) of all moves of robots from their places."""


class SparseOptions:
    """Rows and columns as dictionaries."""

    def __init__(self, robots: int, nodes: int) -> None:
        self._rows: list[dict[int, int]] = [{IDLE: 0} for _ in range(robots)]
        self._columns: list[dict[int, int]] = [{} for _ in range(nodes)]
        self._columns[IDLE] = dict.fromkeys(range(robots), 0)
        self._level = [0] * robots
        self._place = [IDLE] * robots
        self._price = [0] * nodes
        # The rows as a table, which is brought up to date when it is looked at.
        self._nodes = np.zeros((0, 0), dtype=np.intp)
        self._values = np.zeros((0, 0), dtype=np.int64)
        self._changed: set[int] = set()

    def set_robot(self, robot: int, row: Row) -> None:
        if robot == len(self._rows):
            self._rows.append({})
            self._level.append(0)
            self._place.append(IDLE)
        self._rows[robot] = {**row, IDLE: 0}
        for node, performance in self._rows[robot].items():
            self._columns[node][robot] = performance
        self._changed.add(robot)

    def drop_robot(self, robot: int) -> None:
        for node in self._rows[robot]:
            del self._columns[node][robot]
        self._rows[robot] = {}
        self._changed.add(robot)

    def set_column(self, node: int, column: Row) -> None:
        if node == len(self._columns):
            self._columns.append({})
            self._price.append(0)
        self._changed.update(self._columns[node])
        for robot in self._columns[node]:
            del self._rows[robot][node]
        self._columns[node] = dict(column)
        for robot, performance in column.items():
            self._rows[robot][node] = performance
        self._changed.update(column)

    def performance(self, robot: int, node: int) -> int | None:
        return self._rows[robot].get(node)

    def row(self, robot: int) -> dict[int, int]:
        return {node: value for node, value in self._rows[robot].items() if node != IDLE}

    def highest_offer(self, node: int) -> int | None:
        level = self._level
        return max((p - level[robot] for robot, p in self._columns[node].items()), default=None)

    def is_content(self, robot: int) -> bool:
        level, price = self._level[robot], self._price
        return all(level + price[node] >= p for node, p in self._rows[robot].items())

    def lift(self, robot: int) -> None:
        price = self._price
        self._place[robot] = ENTRY
        self._level[robot] = max(p - price[node] for node, p in self._rows[robot].items())

    def put(self, robot: int, node: int) -> None:
        self._place[robot] = node
        self._level[robot] = self._rows[robot][node] - self._price[node]

    def level(self, robot: int) -> int:
        return self._level[robot]

    def price(self, node: int) -> int:
        return self._price[node]

    def prices(self) -> list[int]:
        return self._price

    def reprice(self, node: int, price: int, robots: Iterable[int]) -> None:
        change = self._price[node] - price
        self._price[node] = price
        for robot in robots:
            self._level[robot] += change

    def begin(self, side: int) -> None:
        pass

    def into(self, side: int, node: int, base: int, limit: int) -> list[tuple[int, int]]:
        level, place = self._level, self._place
        base += self._price[node]
        return [
            (place[robot], cost)
            for robot, performance in self._columns[node].items()
            if (cost := base + level[robot] - performance) <= limit
        ]

    def out_of(
        self, side: int, node: int, robots: Iterable[int], base: int, limit: int
    ) -> list[tuple[int, int]]:
        price, found = self._price, []
        for robot in robots:
            start = base + self._level[robot]
            found += [
                (other, cost)
                for other, performance in self._rows[robot].items()
                if (cost := start + price[other] - performance) <= limit
            ]
        return found

    def mover(self, robots: Iterable[int], node: int) -> int:
        level, column = self._level, self._columns[node]
        return min((level[robot] - column[robot], robot) for robot in robots if robot in column)[1]

    def tight(self) -> tuple[Integers, Integers]:
        self._tabulate()
        count = len(self._rows)
        costs = np.array(self._price, dtype=np.int64).take(self._nodes[:count])
        costs += np.array(self._level, dtype=np.int64)[:, None]
        robots, columns = (costs == self._values[:count]).nonzero()
        return robots, self._nodes[robots, columns]

    def _tabulate(self) -> None:
        rows, changed = self._rows, self._changed
        width = max((len(rows[robot]) for robot in changed), default=0)
        if len(rows) > len(self._nodes) or width > self._nodes.shape[1]:
            shape = len(rows) + len(rows) // 8 + 8, max(map(len, rows)) + 4
            self._nodes = np.zeros(shape, dtype=np.intp)
            self._values = np.zeros(shape, dtype=np.int64)
            changed = set(range(len(rows)))
        self._values[list(changed)] = CANNOT
        for robot in changed:
            row, count = rows[robot], len(rows[robot])
            self._nodes[robot, :count] = list(row)
            self._values[robot, :count] = list(row.values())
        self._changed = set()

    def moves(self, place: Integers) -> tuple[Integers, Integers, Integers]:
        sizes = [len(row) for row in self._rows]
        total = sum(sizes)
        nodes = np.fromiter((n for row in self._rows for n in row), np.int64, total)
        values = np.fromiter((p for row in self._rows for p in row.values()), np.int64, total)
        robots = np.repeat(np.arange(len(sizes)), sizes)
        here = np.zeros(len(sizes), np.int64)
        own = nodes == place[robots]
        here[robots[own]] = values[own]
        return robots[~own], nodes[~own], (here[robots] - values)[~own]


class DenseOptions:
    """A matrix of int64 with room for more. `_own` is the performance of a robot where it is. What
    has been reached is remembered per node, so that a step gives only what is new.
    """

    def __init__(self, robots: int, nodes: int) -> None:
        rows, columns = robots + robots // 8 + 8, nodes + nodes // 8 + 8
        self._matrix = np.full((rows, columns), CANNOT, dtype=np.int64)
        self._matrix[:robots, IDLE] = 0
        self._own = np.zeros(rows, dtype=np.int64)
        self._place = np.zeros(rows, dtype=np.intp)
        self._price = np.zeros(columns, dtype=np.int64)
        self._reached = np.zeros((2, columns), dtype=np.int64)
        self._count = nodes

    def _grow(self, rows: int, columns: int) -> None:
        """Double what is too small."""
        old = self._matrix
        height, width = old.shape
        height, width = height << (rows > height), width << (columns > width)
        if (height, width) == old.shape:
            return
        self._matrix = np.full((height, width), CANNOT, dtype=np.int64)
        self._matrix[: old.shape[0], : old.shape[1]] = old
        self._own = np.resize(self._own, height)
        self._place = np.resize(self._place, height)
        self._price = np.resize(self._price, width)
        self._reached = np.zeros((2, width), dtype=np.int64)

    def set_robot(self, robot: int, row: Row) -> None:
        self._grow(robot + 1, 0)
        line = self._matrix[robot]
        line[:] = CANNOT
        line[IDLE] = 0
        line[list(row)] = list(row.values())

    def drop_robot(self, robot: int) -> None:
        self._matrix[robot] = CANNOT

    def set_column(self, node: int, column: Row) -> None:
        self._grow(0, node + 1)
        self._count = max(self._count, node + 1)
        line = self._matrix[:, node]
        line[:] = CANNOT
        line[list(column)] = list(column.values())

    def performance(self, robot: int, node: int) -> int | None:
        found = int(self._matrix[robot, node])
        return None if found == CANNOT else found

    def row(self, robot: int) -> dict[int, int]:
        line = self._matrix[robot]
        nodes = np.flatnonzero(line != CANNOT)[1:]  # IDLE is the first
        return dict(zip(nodes.tolist(), line[nodes].tolist(), strict=True))

    def _levels(self) -> Integers:
        return self._own - self._price[self._place]

    def highest_offer(self, node: int) -> int | None:
        line = self._matrix[:, node]
        robots = np.flatnonzero(line != CANNOT)
        return int((line - self._levels())[robots].max()) if len(robots) else None

    def is_content(self, robot: int) -> bool:
        return bool((self._matrix[robot] - self._price <= self.level(robot)).all())

    def _set_place(self, robot: int, node: int, own: int) -> None:
        self._place[robot], self._own[robot] = node, own

    def lift(self, robot: int) -> None:
        level = int((self._matrix[robot] - self._price).max())
        self._set_place(robot, ENTRY, level + self.price(ENTRY))

    def put(self, robot: int, node: int) -> None:
        self._set_place(robot, node, int(self._matrix[robot, node]))

    def level(self, robot: int) -> int:
        return int(self._own[robot] - self._price[self._place[robot]])

    def price(self, node: int) -> int:
        return int(self._price[node])

    def prices(self) -> list[int]:
        prices: list[int] = self._price[: self._count].tolist()
        return prices

    def reprice(self, node: int, price: int, robots: Iterable[int]) -> None:
        self._price[node] = price

    def begin(self, side: int) -> None:
        self._reached[side] = UNREACHED

    def into(self, side: int, node: int, base: int, limit: int) -> Iterable[tuple[int, int]]:
        costs = np.full(len(self._price), -CANNOT)
        np.minimum.at(costs, self._place, self._own - self._matrix[:, node])
        costs -= self._price
        costs += base + int(self._price[node])
        return self._new(side, costs, limit)

    def out_of(
        self, side: int, node: int, robots: Iterable[int], base: int, limit: int
    ) -> Iterable[tuple[int, int]]:
        movers = list(robots)
        if not movers:
            return ()
        costs = (self._own[movers, None] - self._matrix[movers]).min(axis=0)
        costs += self._price
        costs += base - int(self._price[node])
        return self._new(side, costs, limit)

    def _new(self, side: int, costs: Integers, limit: int) -> Iterable[tuple[int, int]]:
        reached = self._reached[side]
        nodes = (costs < np.minimum(reached, limit + 1)).nonzero()[0]
        reached[nodes] = costs = costs[nodes]
        return zip(nodes.tolist(), costs.tolist(), strict=True)

    def mover(self, robots: Iterable[int], node: int) -> int:
        movers = list(robots)
        return movers[int((self._own[movers] - self._matrix[movers, node]).argmin())]

    def tight(self) -> tuple[Integers, Integers]:
        tight = self._matrix - self._price == self._levels()[:, None]
        robots = np.repeat(np.arange(len(tight)), np.count_nonzero(tight, axis=1))
        return robots, np.flatnonzero(tight) - robots * tight.shape[1]

    def moves(self, place: Integers) -> tuple[Integers, Integers, Integers]:
        matrix = self._matrix[: len(place)]
        here = matrix[np.arange(len(place)), place]
        can = matrix != CANNOT
        can[np.arange(len(place)), place] = False
        robots, nodes = np.nonzero(can)
        return robots, nodes, here[robots] - matrix[robots, nodes]
