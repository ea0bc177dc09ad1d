"""An optimal assignment, kept up to date by shortest paths.

Successive shortest paths (Ahuja, Magnanti, Orlin: Network Flows, 9.7) lead from optimum to optimum:
take one robot more or less somewhere, and send the difference along a shortest path to where it is
missing, or from where it can be had.

Nodes are the demands, `IDLE`, and `ENTRY`, where robots come in. A robot's moves are arcs; between
a demand and `IDLE` there is an arc of cost 0 while the bounds leave room. Every node has a price:
no move costs less than nothing at these prices. `_Search` is Dijkstra's algorithm on them, and
visits few nodes. Which of several optima is found does not matter here: `ties` chooses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import TypeAlias

from mrbt_mesh.core.incremental.assignment.arc_costs import (
    ENTRY,
    FAR,
    IDLE,
    MAX_DISTANCE,
    NEAR,
    UNREACHED,
    Options,
)

# In place of a robot: nobody moves, a demand is content with one less, or takes one more.
SLACK = -1
MOVE = 0  # some robot moves

Arc: TypeAlias = tuple[int, int, int]  # (robot or SLACK, node it leaves, node it goes to)
Step: TypeAlias = tuple[int, int]  # (node, cost up to there)
HEAD_START = 16  # visits from the one end before the other end is begun with


class InfeasibleError(Exception):
    """The bounds cannot be met any more."""


class TooFarError(Exception):
    """More nodes would have to be visited than are allowed."""


@dataclass
class Residual:
    """Robots and nodes by number, as `Options` has them.

    `required` is how many robots a demand is to have at present, within its bounds; it is how many
    it has, but for `missing`, within an event. `moved`: the robots that have been, since this was
    last cleared. Every search adds to `visits`, and raises TooFarError beyond `most_visits`.
    """

    options: Options
    place: list[int]
    members: list[dict[int, None]]
    lower: list[int]
    upper: list[int]
    required: list[int]
    missing: dict[int, int] = field(default_factory=dict)
    moved: dict[int, None] = field(default_factory=dict)
    visits: int = 0
    most_visits: int = UNREACHED

    # -- events ---------------------------------------------------------------------------------
    # Robots that come in wait at `ENTRY`, and places are `missing`, until `settle`: often the ones
    # can go to the others.

    def enter(self, robot: int) -> None:
        """A robot, which has just been put in the options, is to get a place."""
        self.place[robot] = ENTRY
        self.members[ENTRY][robot] = None
        self.options.lift(robot)

    def leave(self, robot: int) -> None:
        """A robot is gone: from its place, and from the options."""
        node = self.place[robot]
        del self.members[node][robot]
        self.options.drop_robot(robot)
        self.place[robot] = IDLE
        if node not in (IDLE, ENTRY):
            self.missing[node] = self.missing.get(node, 0) + 1

    def replace(self, old: int, new: int) -> bool:
        """Put `new` where `old` is, if that is optimal still; `old` is nowhere then."""
        node = self.place[old]
        if self.options.performance(new, node) is None:
            return False
        self.options.put(new, node)
        if not self.options.is_content(new):
            return False
        del self.members[node][old]
        self.members[node][new] = None
        self.place[old], self.place[new] = IDLE, node
        self.options.drop_robot(old)
        self.moved[new] = None
        return True

    def open(self, node: int, bound: int) -> None:
        """A demand, in the options already, for just so many robots: dear enough for all."""
        price = self.options.highest_offer(node)
        self.options.reprice(node, self.options.price(IDLE) if price is None else price, ())
        self.lower[node] = self.upper[node] = self.required[node] = bound
        if bound:
            self.missing[node] = bound

    def close(self, node: int) -> None:
        """A demand is gone; the robots it had are to find another place."""
        robots = list(self.members[node])
        self.members[node] = {}
        self.lower[node] = self.upper[node] = self.required[node] = 0
        self.options.set_column(node, {})
        for robot in robots:
            self.enter(robot)

    def widen(self, node: int, lower: int, upper: int) -> None:
        """Bounds down to `lower`, up to `upper`, as far as that allows more than before."""
        while self.upper[node] < upper and self._sign(node) > 0:
            self.upper[node] += 1
            self.required[node] += 1
            self._fill(node)
        self.upper[node] = max(self.upper[node], upper)
        while self.lower[node] > lower and self._sign(node) < 0:
            self.lower[node] -= 1
            self._release(node)
        self.lower[node] = min(self.lower[node], lower)

    def narrow(self, node: int, lower: int, upper: int) -> None:
        """Bounds up to `lower`, down to `upper`, as far as that allows less than before."""
        while self.upper[node] > upper:
            self.upper[node] -= 1
            if self.required[node] > self.upper[node]:
                self._release(node)
        while self.lower[node] < lower:
            self.lower[node] += 1
            if self.required[node] < self.lower[node]:
                self.required[node] += 1
                self.missing[node] = self.missing.get(node, 0) + 1

    def settle(self) -> None:
        """Robots that wait get a place, and places that are missing get a robot.

        Raises InfeasibleError.
        """
        for robot in self.members[ENTRY]:
            self.options.lift(robot)
        while self.members[ENTRY]:
            self._drain(ENTRY)
        while self.missing:
            node = next(iter(self.missing))
            self._found(node)
            self._fill(node)

    # -- paths ----------------------------------------------------------------------------------

    def _release(self, node: int) -> None:
        """The demand is to have one robot less."""
        self.required[node] -= 1
        if node in self.missing:
            self._found(node)
        else:
            self._drain(node)

    def _found(self, node: int) -> None:
        self.missing[node] -= 1
        if not self.missing[node]:
            del self.missing[node]

    def _fill(self, node: int) -> None:
        """One robot is missing: from `IDLE` on, each goes where the next has left."""
        self._shift(_Search(self, node, (IDLE,), forward=False).run())

    def _drain(self, node: int) -> None:
        """There is one robot too many: each pushes the next away, up to `IDLE`, or to where one is
        missing."""
        arcs = _Search(self, node, (IDLE, *self.missing), forward=True).run()
        self._shift(arcs)
        if arcs[0][2] != IDLE:
            self._found(arcs[0][2])

    def _shift(self, arcs: Iterable[Arc]) -> None:
        for robot, origin, node in arcs:
            if robot != SLACK:
                self.move(robot, node)
            elif origin == IDLE:
                self.required[node] -= 1
            else:
                self.required[origin] += 1
        if abs(self.options.price(IDLE)) > MAX_DISTANCE >> 1:
            self._rebase()

    def _rebase(self) -> None:
        """Only differences of prices matter: keep them small."""
        base = self.options.price(IDLE)
        for node, robots in enumerate(self.members):
            if node != ENTRY:
                self.options.reprice(node, self.options.price(node) - base, robots)

    def move(self, robot: int, node: int) -> None:
        del self.members[self.place[robot]][robot]
        self.members[node][robot] = None
        self.place[robot] = node
        self.options.put(robot, node)
        self.moved[robot] = None

    def _sign(self, node: int) -> int:
        """Of the price: a demand is full where it is dear, at its least where it is negative."""
        return self.options.price(node) - self.options.price(IDLE)


class _Search:
    """A shortest path between a node and the nearest of some others: Dijkstra's algorithm from the
    node, after some visits from both ends.

    forward: from the node to the others; else the other way round.
    """

    def __init__(
        self, residual: Residual, start: int, ends: tuple[int, ...], *, forward: bool
    ) -> None:
        self.residual = residual
        self.near = _Side(residual, NEAR, (start,), forward=forward)
        self.far = _Side(residual, FAR, ends, forward=not forward)
        self.start = start
        self.best = UNREACHED
        self.meeting = start

    def run(self) -> list[Arc]:
        """Adjust the prices; the arcs of the path, from its far end. Raises InfeasibleError,
        TooFarError."""
        near, far, visits = self.near, self.far, 0
        while (close := near.top()) + far.top() < self.best:
            if visits < HEAD_START or len(near.cost) <= len(far.cost):
                self._visit(near, far)
            else:
                self._visit(far, near)
            visits += 1
        if self.best == UNREACHED:
            raise InfeasibleError
        # So that the path costs nothing, and no other move less: the nodes near the one end move
        # by what is left of a radius, those near the other end by what is left of the rest.
        radius = min(close, self.best)
        near.adjust_prices(radius)
        far.adjust_prices(self.best - radius)
        arcs = [(kind, node, origin) for kind, origin, node in far.back(self.meeting)][::-1]
        arcs += near.back(self.meeting)
        if not near.forward:
            arcs = [(kind, there, here) for kind, here, there in arcs]
        options, members = self.residual.options, self.residual.members
        return [
            (SLACK if kind == SLACK else options.mover(members[here], there), here, there)
            for kind, here, there in arcs
        ]

    def _visit(self, side: _Side, other: _Side) -> None:
        residual = self.residual
        cost, node = heappop(side.heap)
        residual.visits += len(residual.members[ENTRY]) if node == ENTRY else 1
        if residual.visits > residual.most_visits:
            raise TooFarError
        known, across, way, heap = side.cost, other.cost, side.way, side.heap
        for kind, steps in side.arcs(node, cost, self.best - 1):
            for to, total in steps:
                if total >= known.get(to, UNREACHED) or (to == ENTRY and to != self.start):
                    continue
                known[to] = total
                way[to] = (kind, node)
                heappush(heap, (total, to))
                if to in across and total + across[to] < self.best:
                    self.best = total + across[to]
                    self.meeting = to


class _Side:
    """Dijkstra's algorithm from one end. `cost` is the least so far, per node; `way` is from where,
    by MOVE or SLACK."""

    def __init__(
        self, residual: Residual, side: int, starts: tuple[int, ...], *, forward: bool
    ) -> None:
        self.residual = residual
        self.side = side
        self.forward = forward
        self.cost = dict.fromkeys(starts, 0)
        self.way: dict[int, tuple[int, int]] = {}
        self.heap = [(0, start) for start in sorted(starts)]
        residual.options.begin(side)

    def top(self) -> int:
        """The distance of the node to be visited next."""
        heap, cost = self.heap, self.cost
        while heap:
            distance, node = heap[0]
            if distance == cost[node]:
                return distance
            heappop(heap)
        return UNREACHED

    def arcs(self, node: int, cost: int, limit: int) -> list[tuple[int, Iterable[Step]]]:
        """MOVE or SLACK, and the steps of that kind, for what costs no more than the limit."""
        residual, side = self.residual, self.side
        steps: Iterable[Step]
        if self.forward:
            steps = residual.options.out_of(side, node, residual.members[node], cost, limit)
        else:
            steps = residual.options.into(side, node, cost, limit)
        return [(MOVE, steps), (SLACK, self._slack(node, cost, limit))]

    def _slack(self, node: int, cost: int, limit: int) -> Sequence[Step]:
        """What is nobody's move: to a node that may have more, from one that may have less."""
        residual = self.residual
        price, required = residual.options.price, residual.required
        bounds = residual.upper if self.forward == (node != IDLE) else residual.lower
        if node != IDLE:
            if node == ENTRY or required[node] == bounds[node]:
                return ()
            return [(IDLE, cost + abs(price(IDLE) - price(node)))]
        prices = residual.options.prices()
        base = prices[IDLE]
        return [
            (other, total)
            for other, (have, bound, here) in enumerate(zip(required, bounds, prices, strict=True))
            if have != bound and (total := cost + abs(here - base)) <= limit
        ]

    def back(self, node: int) -> Iterator[Arc]:
        """The way back to the start: (MOVE or SLACK, node before, node after)."""
        while node in self.way:
            kind, origin = self.way[node]
            yield kind, origin, node
            node = origin

    def adjust_prices(self, radius: int) -> None:
        """Move the nodes within the radius by what it is more than their distance."""
        options, members = self.residual.options, self.residual.members
        sign = 1 if self.forward else -1
        for node, cost in self.cost.items():
            if cost < radius and node != ENTRY:
                options.reprice(node, options.price(node) + sign * (radius - cost), members[node])
