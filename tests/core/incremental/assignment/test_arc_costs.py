"""What robots can do and what moves cost is the same, whichever way it is stored."""

from __future__ import annotations

import random

import pytest

from mrbt_mesh.core.incremental.assignment.arc_costs import (
    ENTRY,
    FAR,
    IDLE,
    NEAR,
    UNREACHED,
    DenseOptions,
    Options,
    SparseOptions,
)


class Storages:
    """Both ways to store the same, while robots come, go and move, and prices change."""

    def __init__(self, seed: int, robots: int, nodes: int) -> None:
        self.random = random.Random(seed)
        self.nodes = nodes
        self.both: list[Options] = [SparseOptions(robots, nodes), DenseOptions(robots, nodes)]
        self.place = [IDLE] * robots

    def do(self, change: str, *values: object) -> None:
        for options in self.both:
            getattr(options, change)(*values)

    def members(self, node: int) -> list[int]:
        return [robot for robot, at in enumerate(self.place) if at == node]

    def lift(self, *robots: int) -> None:
        for robot in robots:
            self.place[robot] = ENTRY
            self.do("lift", robot)

    def next(self) -> None:
        rng = self.random
        robot, node = rng.randrange(len(self.place)), rng.randrange(ENTRY + 1, self.nodes)
        getattr(self, rng.choice(["_price", "_move", "_column", "_row", "_robot"]))(robot, node)

    def _price(self, robot: int, node: int) -> None:
        self.do("reprice", node, self.random.randint(-9, 9), self.members(node))

    def _move(self, robot: int, node: int) -> None:
        if self.both[0].performance(robot, node) is not None:
            self.place[robot] = node
            self.do("put", robot, node)

    def _column(self, robot: int, node: int) -> None:
        able = [robot for robot in range(len(self.place)) if self.random.random() < 0.6]
        self.do("set_column", node, {robot: self.random.randint(1, 9) for robot in able})
        self.lift(*self.members(node))

    def _row(self, robot: int, node: int) -> None:
        if robot < len(self.place):
            self.do("drop_robot", robot)
        else:
            self.place.append(ENTRY)
        able = [node for node in range(ENTRY + 1, self.nodes) if self.random.random() < 0.6]
        self.do("set_robot", robot, {node: self.random.randint(1, 9) for node in able})
        self.lift(robot)

    def _robot(self, robot: int, node: int) -> None:
        if len(self.place) < 40:
            self._row(len(self.place), node)

    def steps(self, options: Options, node: int) -> dict[tuple[str, int], int]:
        """The least cost of a move from and to the node, by the other one."""
        found: dict[tuple[str, int], int] = {}
        members = self.members(node)
        options.begin(NEAR)
        for other, cost in options.out_of(NEAR, node, members, 3, UNREACHED - 1):
            found["to", other] = min(cost, found.get(("to", other), UNREACHED))
        for (_, other), cost in found.items():
            mover = options.mover(members, other)
            here, there = options.level(mover), options.performance(mover, other)
            assert there is not None
            assert cost == 3 + here + options.price(other) - there
        options.begin(FAR)
        for other, cost in options.into(FAR, node, 3, UNREACHED - 1):
            found["from", other] = min(cost, found.get(("from", other), UNREACHED))
        return found


@pytest.mark.parametrize("seed", range(4))
def test_what_it_costs_to_move_is_the_same_in_both_storages(seed: int) -> None:
    storages = Storages(seed, 9, 7)
    sparse, dense = storages.both
    for _ in range(200):
        storages.next()
        for node in range(storages.nodes):
            assert storages.steps(sparse, node) == storages.steps(dense, node)
        tight = [set(zip(*map(list, each.tight()), strict=True)) for each in storages.both]
        assert tight[0] == tight[1]
        assert list(sparse.prices()) == list(dense.prices())
