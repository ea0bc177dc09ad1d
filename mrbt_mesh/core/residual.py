"""The canonical optimum of an assignment problem, kept up to date by shortest paths.

Costs are compared first by performance, then by what the canonical order says: robot i on demand
d costs rank(d) * weight(i), where the weight of a robot outweighs all robots after it together.
So the canonical assignment is *the* optimum of one min-cost flow problem, and successive shortest
paths (Ahuja, Magnanti, Orlin: Network Flows, 9.7) lead from optimum to optimum: take one robot
more or less somewhere, and send the difference along a shortest path to or from "idle".

Nodes are the demands, `IDLE`, and `ENTRY`, where robots come in. A robot's moves are arcs; between
a demand and `IDLE` there is an arc of cost 0 while the bounds leave room. Every node has a price,
as a pair (performance, ties) of integers that is never added up: no move costs less than nothing
at these prices. `_Search` is Dijkstra's algorithm on them, and visits few nodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import TypeAlias

from mrbt_mesh.core.options import ENTRY, FAR, IDLE, MAX_DISTANCE, NEAR, UNREACHED, Options

SLACK = (
    -1
)  # in place of a robot: nobody moves, a demand is content with one less, or takes one more

Arc: TypeAlias = tuple[int, int, int]  # (robot or SLACK, node it leaves, node it goes to)
Price: TypeAlias = tuple[int, int]  # or a distance: (by performance, ties)
HEAD_START = 16  # visits from the one end before the other end is begun with


class InfeasibleError(Exception):
    """The bounds cannot be met any more."""


class TooFarError(Exception):
    """More nodes would have to be visited than are allowed."""


@dataclass
class Residual:
    """Robots and nodes by number, as `Options` has them. The fields are for `prices` to fill in.

    `required` is how many robots a demand is to have at present, within its bounds; it is how many
    it has, but within an event. `shift`: the weight of a robot is 2**shift. `moved`: the robots
    that have been, since this was last cleared. Every search adds to `visits`, and raises
    TooFarError beyond `most_visits`.
    """

    options: Options
    place: list[int]
    shift: list[int]
    members: list[dict[int, None]]
    lower: list[int]
    upper: list[int]
    required: list[int]
    rank: list[int]
    tie: list[int]
    moved: dict[int, None] = field(default_factory=dict)
    visits: int = 0
    most_visits: int = UNREACHED

    # -- events ---------------------------------------------------------------------------------

    def enter(self, robot: int) -> None:
        """A robot, which has just been put in the options, gets its place."""
        self.place[robot] = ENTRY
        self.members[ENTRY][robot] = None
        self.options.lift(robot)
        self._drain(ENTRY)

    def leave(self, robot: int) -> None:
        """A robot is gone: from its place, and from the options. Raises InfeasibleError."""
        node = self.place[robot]
        del self.members[node][robot]
        self.options.drop_robot(robot)
        self.place[robot] = IDLE
        if node not in (IDLE, ENTRY):
            self._fill(node)

    def replace(self, old: int, new: int) -> bool:
        """Put `new` where `old` is, if that is optimal still; `old` is nowhere then."""
        node = self.place[old]
        if self.options.performance(new, node) is None:
            return False
        self.options.put(new, node)
        self.options.begin(NEAR)
        for other, cost in self.options.out_of(NEAR, new, 0, 0):
            if cost < 0 or self.tied(new, node, other) < 0:
                return False
        del self.members[node][old]
        self.members[node][new] = None
        self.place[old], self.place[new] = IDLE, node
        self.options.drop_robot(old)
        self.moved[new] = None
        return True

    def open(self, node: int) -> None:
        """A demand, which is in the options already, with bounds 0..0: dear enough for all."""
        price, robots = self.options.highest_offer(node)
        self.tie[node] = 0
        ties = [-self.tied(robot, self.place[robot], node) for robot in robots]
        self.tie[node] = max(ties, default=self.tie[IDLE])
        self.options.reprice(node, price if robots else self.options.price(IDLE), ())

    def close(self, node: int) -> None:
        """A demand is gone; the robots it had find another place."""
        robots = list(self.members[node])
        self.members[node] = {}
        self.lower[node] = self.upper[node] = self.required[node] = 0
        self.options.set_column(node, {})
        rows = [self.options.row(robot) for robot in robots]
        for robot in robots:
            self.options.drop_robot(robot)
        for robot, row in zip(robots, rows, strict=True):
            self.options.set_robot(robot, row)
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
            self.required[node] -= 1
            self._drain(node)
        self.lower[node] = min(self.lower[node], lower)

    def narrow(self, node: int, lower: int, upper: int) -> None:
        """Bounds up to `lower`, down to `upper`, as far as that allows less than before.

        Raises InfeasibleError.
        """
        while self.upper[node] > upper:
            self.upper[node] -= 1
            if self.required[node] > self.upper[node]:
                self.required[node] -= 1
                self._drain(node)
        while self.lower[node] < lower:
            self.lower[node] += 1
            if self.required[node] < self.lower[node]:
                self.required[node] += 1
                self._fill(node)

    # -- paths ----------------------------------------------------------------------------------

    def _fill(self, node: int) -> None:
        """One robot is missing: from `IDLE` on, each goes where the next has left."""
        self._shift(_Search(self, node, forward=False).run())

    def _drain(self, node: int) -> None:
        """There is one robot too many: up to `IDLE`, each pushes the next away."""
        self._shift(_Search(self, node, forward=True).run())

    def _shift(self, arcs: Iterable[Arc]) -> None:
        for robot, origin, node in arcs:
            if robot != SLACK:
                self._move(robot, node)
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

    def _move(self, robot: int, node: int) -> None:
        del self.members[self.place[robot]][robot]
        self.members[node][robot] = None
        self.place[robot] = node
        self.options.put(robot, node)
        self.moved[robot] = None

    def _sign(self, node: int) -> int:
        """Of the price: a demand is full where it is dear, at its least where it is negative."""
        price = self.options.price(node) - self.options.price(IDLE)
        return price or self.tie[node] - self.tie[IDLE]

    def tied(self, robot: int, origin: int, node: int) -> int:
        """The second part of the cost of a move at the present prices."""
        change = self.tie[node] - self.tie[origin]
        if robot == SLACK:
            return change
        return change + ((self.rank[node] - self.rank[origin]) << self.shift[robot])


class _Search:
    """A shortest path between a node and `IDLE`: Dijkstra's algorithm from the node, after some
    visits from both ends, which meet at the arc that is on the shortest path.

    forward: from the node to `IDLE`; else the other way round.
    """

    def __init__(self, residual: Residual, start: int, *, forward: bool) -> None:
        self.residual = residual
        self.near = _Side(residual, NEAR, start, forward=forward)
        self.far = _Side(residual, FAR, IDLE, forward=not forward)
        self.best: Price | None = None
        self.meeting: tuple[int, int, int] = (SLACK, start, IDLE)  # (robot, near node, far node)

    def run(self) -> list[Arc]:
        """Adjust the prices; the arcs of the path. Raises InfeasibleError, TooFarError."""
        near, far = self.near, self.far
        while True:
            close, distant = near.top(), far.top()
            if close is None or distant is None:
                break
            together = (close[0] + distant[0], close[1] + distant[1])
            if self.best is not None and together >= self.best:
                break
            if len(near.visited) < HEAD_START or len(near.visited) <= len(far.visited):
                self._visit(near, far)
            else:
                self._visit(far, near)
        if self.best is None:
            raise InfeasibleError
        self._adjust_prices(close, self.best)
        return list(self._path())

    def _visit(self, side: _Side, other: _Side) -> None:
        self.residual.visits += 1
        if self.residual.visits > self.residual.most_visits:
            raise TooFarError
        limit = UNREACHED if self.best is None else self.best[0]
        for robot, node, origin, total in side.visit(limit):
            if origin in other.visited:
                total += other.visited[origin]
                if self.best is None or total <= self.best[0]:
                    tie = side.tied(robot, node, origin) + other.tie[origin]
                    if self.best is None or (total, tie) < self.best:
                        self.best = (total, tie)
                        ends = (node, origin) if side is self.near else (origin, node)
                        self.meeting = (robot, *ends)

    def _adjust_prices(self, close: Price | None, best: Price) -> None:
        """So that the path costs nothing, and no other move less: the nodes near the one end move
        by what is left of a radius, those near the other end by what is left of the rest."""
        radius = best if close is None else min(close, best)
        rest = (best[0] - radius[0], best[1] - radius[1])
        self.near.adjust_prices(radius)
        self.far.adjust_prices(rest)

    def _path(self) -> Iterator[Arc]:
        robot, here, there = self.meeting
        arcs = [(robot, here, there), *self.near.back(here)]
        arcs += [(robot, node, origin) for robot, origin, node in self.far.back(there)]
        for robot, one, other in arcs:
            yield (robot, one, other) if self.near.forward else (robot, other, one)


class _Side:
    """Dijkstra's algorithm from one end.

    Ties are worked out only where a node is reached at equal cost by several ways, or is about to
    be visited: the numbers are long. All nodes of one cost are a level; within it they are taken
    by their ties.
    """

    def __init__(self, residual: Residual, side: int, start: int, *, forward: bool) -> None:
        self.residual = residual
        self.side = side
        self.start = start
        self.forward = forward
        self.cost = {start: 0}  # least so far, per node
        self.ways: dict[int, list[tuple[int, int]]] = {}  # at that cost: (robot, from where)
        self.way: dict[int, tuple[int, int]] = {}  # the best of them, once a level is open
        self.tie = {start: 0}
        self.base: dict[int, int] = {}  # the part of the ties of the next that is common to all
        self.visited = {start: 0}  # cost
        self.levels: list[tuple[int, int]] = []  # heap of (cost, node)
        self.level: list[tuple[int, int]] = [(0, start)]  # heap of (tie, node)
        self.level_cost = 0
        self.begun = False

    def top(self) -> Price | None:
        """The distance of the node to be visited next."""
        while True:
            while self.level:
                tie, node = self.level[0]
                if tie == self.tie[node] and (node not in self.visited or not self.begun):
                    return self.level_cost, tie
                heappop(self.level)
            if not self.levels:
                return None
            self._open_level()

    def _open_level(self) -> None:
        cost = self.level_cost = self.levels[0][0]
        while self.levels and self.levels[0][0] == cost:
            node = heappop(self.levels)[1]
            if self.cost[node] == cost and node not in self.tie:
                for robot, origin in self.ways[node]:
                    self._reach(robot, origin, node)

    def tied(self, robot: int, origin: int, node: int) -> int:
        """Ties of the distance of `node` by way of `origin`, which has been visited."""
        residual = self.residual
        tie = residual.tie[node]
        result = self.base[origin] + tie if self.forward else self.base[origin] - tie
        if robot == SLACK:
            return result
        change = residual.rank[node] - residual.rank[origin]
        return result + ((change if self.forward else -change) << residual.shift[robot])

    def _decides(self, robot: int, rival: int, origin: int, node: int) -> bool:
        """Whether of two equally good moves the first is the better by ties, or may be: of moves
        to a better rank, that of the robot with more weight, otherwise that of the other."""
        if SLACK in (robot, rival):
            return True
        shift, rank = self.residual.shift, self.residual.rank
        better = (rank[node] < rank[origin]) == self.forward
        return (shift[robot] > shift[rival]) == better

    def _reach(self, robot: int, origin: int, node: int) -> None:
        """A way of the present level's cost: keep it if it is the first or better by its ties."""
        tie = self.tied(robot, origin, node)
        if node not in self.tie or tie < self.tie[node]:
            self.tie[node] = tie
            self.way[node] = (robot, origin)
            heappush(self.level, (tie, node))

    def visit(self, limit: int) -> list[tuple[int, int, int, int]]:
        """The next node. Returns the arcs from it up to the limit: (robot, node, other node, cost
        up to there)."""
        node, cost = heappop(self.level)[1], self.level_cost
        if not self.begun:
            self.begun = True
            self.residual.options.begin(self.side)
        self.visited[node] = cost
        here = self.residual.tie[node]
        self.base[node] = self.tie[node] + (-here if self.forward else here)
        found, taken = [], dict[int, int]()
        for robot, other, total in self._arcs(node, cost, limit):
            if other in self.visited:
                continue
            found.append((robot, node, other, total))
            if total > self.cost.get(other, UNREACHED) or other == ENTRY:
                continue  # nobody moves to the entry, and its price means nothing
            if total > cost or node == self.start:
                self._put_off(robot, node, other, total)
            elif other not in taken or self._decides(robot, taken[other], node, other):
                taken[other] = robot
                self.cost[other] = total
                self._reach(robot, node, other)
        return found

    def _put_off(self, robot: int, origin: int, node: int, cost: int) -> None:
        """A way of a later level's cost."""
        ways = self.ways.get(node)
        if ways is None or cost < self.cost[node]:
            self.cost[node] = cost
            self.ways[node] = [(robot, origin)]
            heappush(self.levels, (cost, node))
        elif ways[-1][1] != origin or SLACK in (robot, ways[-1][0]):
            ways.append((robot, origin))
        elif self._decides(robot, ways[-1][0], origin, node):
            ways[-1] = (robot, origin)

    def _arcs(self, node: int, cost: int, limit: int) -> list[tuple[int, int, int]]:
        """(robot, other node, cost up to there)."""
        residual = self.residual
        options, side = residual.options, self.side
        arcs = self._slack(node, cost)
        if self.forward:
            for robot in residual.members[node]:
                moves = options.out_of(side, robot, cost, limit)
                arcs += [(robot, to, total) for to, total in moves]
        else:
            place = residual.place
            moves = options.into(side, node, cost, limit)
            arcs += [(robot, place[robot], total) for robot, total in moves]
        return arcs

    def _slack(self, node: int, cost: int) -> list[tuple[int, int, int]]:
        """The arcs that are nobody's move: to a node that may have more, from one that may have
        less."""
        residual = self.residual
        price = residual.options.price
        required = residual.required
        bounds = residual.upper if self.forward == (node != IDLE) else residual.lower
        if node != IDLE:
            if required[node] == bounds[node]:
                return []
            change = price(IDLE) - price(node)
            return [(SLACK, IDLE, cost + change if self.forward else cost - change)]
        base = price(IDLE)
        return [
            (SLACK, other, cost + abs(price(other) - base))
            for other in range(ENTRY + 1, len(required))
            if required[other] != bounds[other]
        ]

    def back(self, node: int) -> Iterator[Arc]:
        """The way back to the start, as arcs (robot, node before, node after)."""
        while node != self.start:
            robot, origin = self.way[node]
            yield robot, origin, node
            node = origin

    def adjust_prices(self, radius: Price) -> None:
        """Move the nodes within the radius by what it is more than their distance."""
        residual, options = self.residual, self.residual.options
        for node, cost in self.visited.items():
            distance = (cost, self.tie[node])
            if node == ENTRY or distance >= radius:
                continue
            change, step = radius[0] - cost, radius[1] - distance[1]
            residual.tie[node] += step if self.forward else -step
            if change:
                price = options.price(node) + (change if self.forward else -change)
                options.reprice(node, price, residual.members[node])
