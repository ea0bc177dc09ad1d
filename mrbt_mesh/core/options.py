"""Which robot can do what, and what it would cost to move it: one step of a shortest path.

Robots and nodes are small integers; node `IDLE` is what everybody can do for nothing. Two ways to
store the same: dictionaries, where few robots can do a demand, and a matrix, where most can.

The level of a robot is its performance where it is, minus the price of that node. Moving it to
another node costs level - (performance there - price there), which is never negative at an optimum.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
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

    def highest_offer(self, node: int) -> tuple[int, list[int]]:
        """The price from which on no robot would move to the node, and who would next."""

    def put(self, robot: int, node: int) -> None:
        """The robot is on this node now, which it can do."""

    def lift(self, robot: int) -> None:
        """The robot is at `ENTRY` now, at such a level that its cheapest move costs nothing."""

    def level(self, robot: int) -> int: ...

    def price(self, node: int) -> int: ...

    def reprice(self, node: int, price: int, robots: Iterable[int]) -> None:
        """Set the price of a node; `robots` are those on it."""

    def begin(self, side: int) -> None:
        """A search begins: nothing has been reached from that side."""

    def into(self, side: int, node: int, base: int, limit: int) -> Iterable[tuple[int, int]]:
        """(robot, base + cost of moving it to `node`), up to `limit`.

        May leave out what is dearer than something given before on that side for the same origin,
        and on the near side, what is dearer than `IDLE`.
        """

    def out_of(self, side: int, robot: int, base: int, limit: int) -> Iterable[tuple[int, int]]:
        """(node, base + cost of moving the robot there), up to `limit`; likewise."""

    def moves(self, place: Integers) -> tuple[Integers, Integers, Integers]:
        """(robot, node, cost at equal prices) of all moves of robots from their places."""


class SparseOptions:
    """Rows and columns as dictionaries."""

    def __init__(self, robots: int, nodes: int) -> None:
        self._rows: list[dict[int, int]] = [{IDLE: 0} for _ in range(robots)]
        self._columns: list[dict[int, int]] = [{} for _ in range(nodes)]
        self._columns[IDLE] = dict.fromkeys(range(robots), 0)
        self._level = [0] * robots
        self._price = [0] * nodes

    def set_robot(self, robot: int, row: Row) -> None:
        if robot == len(self._rows):
            self._rows.append({})
            self._level.append(0)
        self._rows[robot] = {**row, IDLE: 0}
        for node, performance in self._rows[robot].items():
            self._columns[node][robot] = performance

    def drop_robot(self, robot: int) -> None:
        for node in self._rows[robot]:
            del self._columns[node][robot]
        self._rows[robot] = {}

    def set_column(self, node: int, column: Row) -> None:
        if node == len(self._columns):
            self._columns.append({})
            self._price.append(0)
        for robot in self._columns[node]:
            del self._rows[robot][node]
        self._columns[node] = dict(column)
        for robot, performance in column.items():
            self._rows[robot][node] = performance

    def performance(self, robot: int, node: int) -> int | None:
        return self._rows[robot].get(node)

    def row(self, robot: int) -> dict[int, int]:
        return {node: value for node, value in self._rows[robot].items() if node != IDLE}

    def highest_offer(self, node: int) -> tuple[int, list[int]]:
        offers = {robot: p - self._level[robot] for robot, p in self._columns[node].items()}
        price = max(offers.values(), default=0)
        return price, [robot for robot, offer in offers.items() if offer == price]

    def lift(self, robot: int) -> None:
        price = self._price
        self._level[robot] = max(p - price[node] for node, p in self._rows[robot].items())

    def put(self, robot: int, node: int) -> None:
        self._level[robot] = self._rows[robot][node] - self._price[node]

    def level(self, robot: int) -> int:
        return self._level[robot]

    def price(self, node: int) -> int:
        return self._price[node]

    def reprice(self, node: int, price: int, robots: Iterable[int]) -> None:
        change = self._price[node] - price
        self._price[node] = price
        for robot in robots:
            self._level[robot] += change

    def begin(self, side: int) -> None:
        pass

    def into(self, side: int, node: int, base: int, limit: int) -> list[tuple[int, int]]:
        level = self._level
        base += self._price[node]
        return [
            (robot, cost)
            for robot, performance in self._columns[node].items()
            if (cost := base + level[robot] - performance) <= limit
        ]

    def out_of(self, side: int, robot: int, base: int, limit: int) -> list[tuple[int, int]]:
        price = self._price
        base += self._level[robot]
        return [
            (node, cost)
            for node, performance in self._rows[robot].items()
            if (cost := base + price[node] - performance) <= limit
        ]

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
    """A matrix of int64 with room for more; what has been reached is remembered per node, so that
    a step gives only what is new."""

    def __init__(self, robots: int, nodes: int) -> None:
        rows, columns = robots + robots // 8 + 8, nodes + nodes // 8 + 8
        self._matrix = np.full((rows, columns), CANNOT, dtype=np.int64)
        self._matrix[:robots, IDLE] = 0
        self._level = np.zeros(rows, dtype=np.int64)
        self._place = np.zeros(rows, dtype=np.intp)
        self._price = np.zeros(columns, dtype=np.int64)
        self._reached = np.zeros((2, columns), dtype=np.int64)

    def _grow(self, rows: int, columns: int) -> None:
        """Double what is too small."""
        old = self._matrix
        height, width = old.shape
        height, width = height << (rows > height), width << (columns > width)
        if (height, width) == old.shape:
            return
        self._matrix = np.full((height, width), CANNOT, dtype=np.int64)
        self._matrix[: old.shape[0], : old.shape[1]] = old
        self._level = np.resize(self._level, height)
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

    def highest_offer(self, node: int) -> tuple[int, list[int]]:
        line = self._matrix[:, node]
        robots = np.flatnonzero(line != CANNOT)
        offers = line[robots] - self._level[robots]
        price = int(offers.max(initial=CANNOT))
        return price, robots[offers == price].tolist()

    def lift(self, robot: int) -> None:
        self._place[robot] = ENTRY
        self._level[robot] = np.max(self._matrix[robot] - self._price)

    def put(self, robot: int, node: int) -> None:
        self._place[robot] = node
        self._level[robot] = self._matrix[robot, node] - self._price[node]

    def level(self, robot: int) -> int:
        return int(self._level[robot])

    def price(self, node: int) -> int:
        return int(self._price[node])

    def reprice(self, node: int, price: int, robots: Iterable[int]) -> None:
        change = int(self._price[node]) - price
        self._price[node] = price
        for robot in robots:
            self._level[robot] += change

    def begin(self, side: int) -> None:
        self._reached[side] = UNREACHED

    def into(self, side: int, node: int, base: int, limit: int) -> Iterator[tuple[int, int]]:
        costs = self._level - self._matrix[:, node]
        costs += base + int(self._price[node])
        reached = self._reached[side]
        robots = np.flatnonzero(costs <= np.minimum(reached, limit)[self._place])
        costs, places = costs[robots], self._place[robots]
        np.minimum.at(reached, places, costs)
        most = reached[places]
        if side == NEAR:
            np.minimum(most, reached[IDLE], out=most)
        news = costs <= most
        return zip(robots[news].tolist(), costs[news].tolist(), strict=True)

    def out_of(self, side: int, robot: int, base: int, limit: int) -> Iterator[tuple[int, int]]:
        costs = self._price - self._matrix[robot]
        costs += base + int(self._level[robot])
        reached = self._reached[side]
        if side == NEAR:
            limit = min(limit, int(costs[IDLE]))
        nodes = np.flatnonzero(costs <= np.minimum(reached, limit))
        costs = costs[nodes]
        reached[nodes] = costs
        return zip(nodes.tolist(), costs.tolist(), strict=True)

    def moves(self, place: Integers) -> tuple[Integers, Integers, Integers]:
        matrix = self._matrix[: len(place)]
        here = matrix[np.arange(len(place)), place]
        can = matrix != CANNOT
        can[np.arange(len(place)), place] = False
        robots, nodes = np.nonzero(can)
        return robots, nodes, here[robots] - matrix[robots, nodes]
