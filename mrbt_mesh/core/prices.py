"""Prices of an optimum, from nothing but the optimum: shortest distances (Bellman and Ford)."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from mrbt_mesh.core.assignment import SolverError
from mrbt_mesh.core.options import ENTRY, IDLE, Integers
from mrbt_mesh.core.residual import Residual


def set_prices(residual: Residual, prices: Sequence[int] | None = None) -> None:
    """Give every node its price. `prices`: those of the nodes by performance, where known.

    Raises SolverError if the assignment is not the canonical optimum.
    """
    place = np.array(residual.place, dtype=np.int64)
    robots, nodes, costs = residual.options.moves(place)
    if prices is None:
        prices = _prices(residual, place[robots], nodes, costs)
    by_node = np.array(prices, dtype=np.int64)
    for node, price in enumerate(prices):
        residual.options.reprice(node, price, ())
    for node, members in enumerate(residual.members):
        for robot in members:
            residual.options.put(robot, node)
    tight = np.flatnonzero(costs + by_node[nodes] == by_node[place[robots]])
    residual.tie[:] = _ties(residual, prices, robots[tight], nodes[tight])


def _slack(residual: Residual) -> list[tuple[int, int]]:
    """(from, to) of the arcs that the bounds leave room for, as moves of nobody."""
    arcs = []
    for node in range(ENTRY + 1, len(residual.members)):
        if residual.required[node] > residual.lower[node]:
            arcs.append((IDLE, node))
        if residual.required[node] < residual.upper[node]:
            arcs.append((node, IDLE))
    return arcs


def _prices(residual: Residual, origins: Integers, nodes: Integers, costs: Integers) -> list[int]:
    slack = np.array(_slack(residual), dtype=np.int64).reshape(-1, 2)
    origins = np.concatenate((origins, slack[:, 0]))
    nodes = np.concatenate((nodes, slack[:, 1]))
    costs = np.concatenate((costs, np.zeros(len(slack), dtype=np.int64)))
    order = np.argsort(origins, kind="stable")
    origins, nodes, costs = origins[order], nodes[order], costs[order]
    result = np.zeros(len(residual.members), dtype=np.int64)
    if len(origins):
        starts = np.flatnonzero(np.diff(origins, prepend=-1))
        sources = origins[starts]
        for _ in range(len(result) + 1):
            better = np.minimum.reduceat(result[nodes] + costs, starts)
            if not (better < result[sources]).any():
                break
            result[sources] = np.minimum(result[sources], better)
        else:
            raise SolverError("the assignment is not optimal: moving robots around a cycle gains")
    result -= result[IDLE]
    result[ENTRY] = 0
    return result.tolist()


def _ties(
    residual: Residual, prices: Sequence[int], robots: Integers, nodes: Integers
) -> list[int]:
    """The second part of the prices, from the moves whose first part costs nothing.

    Of several robots that could make the same move, the one that decides is the first of all if
    the move is to a better rank, otherwise the last.
    """
    count = len(residual.members)
    place, rank = np.array(residual.place, dtype=np.int64), np.array(residual.rank)
    shift = np.array(residual.shift, dtype=np.int64)
    origins = place[robots]
    key = np.where(rank[nodes] < rank[origins], -shift[robots], shift[robots])
    order = np.lexsort((key, origins * count + nodes))
    pairs = (origins * count + nodes)[order]
    deciding = order[np.flatnonzero(np.diff(pairs, prepend=-1))]
    into: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for robot in deciding.tolist():
        who, node, origin = int(robots[robot]), int(nodes[robot]), int(origins[robot])
        change = residual.rank[node] - residual.rank[origin]
        into[node].append((origin, change << residual.shift[who]))
    for origin, node in _slack(residual):
        if prices[origin] == prices[node]:
            into[node].append((origin, 0))
    result = [0] * count
    queue = deque(range(count))
    waiting = [True] * count
    visits = 0
    while queue:
        node = queue.popleft()
        waiting[node] = False
        visits += 1
        if visits > count * (count + 1):
            raise SolverError("the optimum is not the canonical one")
        for origin, cost in into[node]:
            if result[node] + cost < result[origin]:
                result[origin] = result[node] + cost
                if not waiting[origin]:
                    waiting[origin] = True
                    queue.append(origin)
    idle = result[IDLE]
    return [tie - idle if node != ENTRY else 0 for node, tie in enumerate(result)]
