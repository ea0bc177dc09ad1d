"""Prices of an optimum, from nothing but the optimum: shortest distances (Bellman and Ford)."""

from __future__ import annotations

import numpy as np

from mrbt_mesh.core.assignment.problem import SolverError
from mrbt_mesh.core.incremental.assignment.arc_costs import ENTRY, IDLE, Integers
from mrbt_mesh.core.incremental.assignment.residual import Residual


def set_prices(residual: Residual) -> None:
    """Give every node its price. Raises SolverError if the assignment is not optimal."""
    place = np.array(residual.place, dtype=np.int64)
    robots, nodes, costs = residual.options.moves(place)
    for node, price in enumerate(_prices(residual, place[robots], nodes, costs)):
        residual.options.reprice(node, price, ())
    for node, members in enumerate(residual.members):
        for robot in members:
            residual.options.put(robot, node)


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
