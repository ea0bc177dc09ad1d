"""Of all optima that cost the same as a given one, the canonical one: `canonical`, on a residual.

Optima differ by moves that cost nothing, around cycles. The prices tell which moves cost nothing;
few of them are on cycles as a rule, and only those are looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mrbt_mesh.core.assignment.tie_breaking import first_of_ties
from mrbt_mesh.core.incremental.assignment.arc_costs import ENTRY, IDLE, Integers
from mrbt_mesh.core.incremental.assignment.residual import Residual

# Options per node up to which it is worth while to look for those on cycles; of more, most are.
FEW = 16
# What leads nowhere is left out step by step, while a step leaves out more than one of so many.
PEEL = 16


def break_ties(residual: Residual, names: Sequence[str], position: Callable[[int], int]) -> None:
    """`names` of the robots by number, and the position of a demand's node, give the order."""
    place = np.array(residual.place, dtype=np.int64)
    robots, nodes = residual.options.tight()
    more, less = _slack(residual)
    count = len(more)
    if len(robots) <= FEW * count:
        kept = _on_cycles(count, robots, nodes, place, more, less)
        robots, nodes = robots[kept], nodes[kept]
    involved = _numbers(len(place), robots)
    if not involved:
        return
    involved.sort(key=names.__getitem__)
    order = sorted(_numbers(count, nodes), key=position)
    robot_index = np.zeros(len(place), dtype=np.int64)
    robot_index[involved] = np.arange(len(involved))
    node_index = np.zeros(count, dtype=np.int64)
    node_index[order] = np.arange(len(order))
    choice = first_of_ties(
        node_index[place[involved]].tolist(),
        robot_index[robots],
        node_index[nodes],
        more[order].tolist(),
        less[order].tolist(),
    )
    for robot, index in zip(involved, choice, strict=True):
        if order[index] != residual.place[robot]:
            residual.move(robot, order[index])
    for node in order:
        if node != IDLE:
            residual.required[node] = len(residual.members[node])


def _numbers(count: int, some: Integers) -> list[int]:
    """Those below `count` that occur, ascending."""
    occurs = np.zeros(count, dtype=np.bool_)
    occurs[some] = True
    found: list[int] = occurs.nonzero()[0].tolist()
    return found


def _slack(residual: Residual) -> tuple[Integers, Integers]:
    """How many robots more or less a node may have where that costs nothing."""
    prices = np.array(residual.options.prices())
    level = prices == prices[IDLE]
    required = np.array(residual.required)
    more = level * (np.array(residual.upper) - required)
    less = level * (required - np.array(residual.lower))
    more[IDLE], less[IDLE] = len(residual.place), len(residual.members[IDLE])
    more[ENTRY] = less[ENTRY] = 0
    return more, less


def _on_cycles(
    count: int, robots: Integers, nodes: Integers, place: Integers, more: Integers, less: Integers
) -> Integers:
    """Of the options, those from where some lead to, to where some lead on, and so on: all that
    are on a cycle, and not many others; with them the places of their robots.

    What goes through the slack goes by `IDLE`.
    """
    origins = place[robots]
    kept = (origins != nodes).nonzero()[0]
    takes, gives = more.nonzero()[0], less.nonzero()[0]
    idle = np.zeros(len(takes) + len(gives), dtype=np.int64)
    sources = np.concatenate((origins[kept], takes, idle[: len(gives)]))
    targets = np.concatenate((nodes[kept], idle[: len(takes)], gives))
    kept = np.concatenate((kept, idle - 1))
    before = 2 * len(kept)
    while len(kept) * PEEL < before * (PEEL - 1):
        before = len(kept)
        entered, left = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
        entered[targets] = left[sources] = True
        on = (entered[sources] & left[targets]).nonzero()[0]
        kept, targets, sources = kept[on], targets[on], sources[on]
    moving = np.zeros(len(place), dtype=np.bool_)
    moving[robots[kept[kept >= 0]]] = True
    own = (moving[robots] & (origins == nodes)).nonzero()[0]
    return np.concatenate((kept[kept >= 0], own))
