"""The canonical optimum of an assignment problem, by ids, and changes to it.

Robots and demands have names here; `Residual` works on their numbers.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Mapping, Sequence

from mrbt_mesh.core.offers import Changes, Offered, Team
from mrbt_mesh.core.options import (
    ENTRY,
    IDLE,
    MAX_DISTANCE,
    UNREACHED,
    DenseOptions,
    Options,
    SparseOptions,
)
from mrbt_mesh.core.prices import set_prices
from mrbt_mesh.core.residual import Residual

# Share of the (robot, demand) pairs from which a matrix is the faster way to store them.
DENSE = 0.25
# Between the ranks of neighbours. When there is no more room, all are ranked again.
GAP = 1 << 4


class Optimum:
    """`assigned` is the canonical optimum: robot -> demand, without the robots that are idle.

    `pairs`: of a robot and a demand that it can do, at the beginning.
    """

    def __init__(
        self, team: Team, assigned: Mapping[str, str], prices: Mapping[str, int] | None = None
    ) -> None:
        """`prices` by demand, where known. Raises SolverError if `assigned` is not canonical."""
        demands = team.demands
        self.assigned = dict(assigned)
        self._numbers = {robot: number for number, robot in enumerate(team.robots)}
        self._nodes = {demand.id: ENTRY + 1 + n for n, demand in enumerate(demands)}
        self._names = list(team.robots)
        self._ids = ["", "", *self._nodes]
        self._free_numbers: list[int] = []
        self._free_nodes: list[int] = []
        place = [self._nodes[assigned[r]] if r in assigned else IDLE for r in team.robots]
        members: list[dict[int, None]] = [{} for _ in self._ids]
        for robot, node in enumerate(place):
            members[node][robot] = None
        self._residual = Residual(
            options=self._options(demands),
            place=place,
            shift=[0] * len(place),
            members=members,
            lower=[0, 0, *(demand.lower for demand in demands)],
            upper=[0, 0, *(demand.upper for demand in demands)],
            required=[0, 0, *map(len, members[ENTRY + 1 :])],
            rank=[0] * len(self._ids),
            tie=[0] * len(self._ids),
        )
        self._count(list(self._nodes), self._names)
        known = None if prices is None else [0, 0, *(prices[demand.id] for demand in demands)]
        set_prices(self._residual, known)

    def _options(self, demands: Sequence[Offered]) -> Options:
        columns = [self._column(demand.candidates) for demand in demands]
        size = len(self._numbers) * len(columns)
        most = max((abs(p) for column in columns for p in column.values()), default=0)
        fits = 8 * most * len(self._ids) < MAX_DISTANCE
        self.pairs = sum(map(len, columns))
        dense = fits and self.pairs > DENSE * size
        kind = DenseOptions if dense else SparseOptions
        options: Options = kind(len(self._numbers), ENTRY + 1 + len(columns))
        for node, column in enumerate(columns, start=ENTRY + 1):
            options.set_column(node, column)
        return options

    def _column(self, candidates: Mapping[str, int]) -> dict[int, int]:
        numbers = self._numbers
        return {numbers[robot]: p for robot, p in candidates.items() if robot in numbers}

    # -- the canonical order --------------------------------------------------------------------

    def _count(self, order: Sequence[str], robots: Sequence[str]) -> None:
        """Ranks and weights with room for more; both may have those that are yet to come."""
        residual = self._residual
        self._ranks = {name: GAP * (place + 1) for place, name in enumerate(order)}
        residual.rank[IDLE] = 2 * GAP * (len(order) + 1)
        for name, node in self._nodes.items():
            residual.rank[node] = self._ranks[name]
        self._digit = residual.rank[IDLE].bit_length() + 1
        self._known = sorted(robots)
        spare = len(robots) // 8 + 8
        self._shifts = {
            robot: self._digit * (spare + place) for place, robot in enumerate(self._known[::-1])
        }
        for robot, number in self._numbers.items():
            residual.shift[number] = self._shifts[robot]

    def _make_room(self, changes: Changes) -> None:
        """Ranks and weights for what is new; if there is no room, all are counted again."""
        robots = [robot for robot in changes.new_robots if robot not in self._shifts]
        if not (self._rank(changes) and all(map(self._weigh, robots))):
            order = changes.order or sorted(self._nodes, key=self._ranks.__getitem__)
            self._count(order, [*self._numbers, *changes.new_robots])
            prices = [self._residual.options.price(node) for node in range(len(self._ids))]
            set_prices(self._residual, prices)

    def _weigh(self, robot: str) -> bool:
        """A robot never seen before has room after all others and before them, only."""
        place = bisect_left(self._known, robot)
        if place == 0:
            shift = self._shifts[self._known[0]] + self._digit if self._known else 0
        elif place == len(self._known):
            shift = self._shifts[self._known[-1]] - self._digit
        else:
            return False
        insort(self._known, robot)
        self._shifts[robot] = shift
        return shift >= 0

    def _rank(self, changes: Changes) -> bool:
        """Ranks between those of the neighbours; at the end, as far apart as at first."""
        for demand in changes.gone_demands:
            del self._ranks[demand]
        last, waiting = 0, list[str]()
        for name in changes.order:
            if name not in self._ranks:
                waiting.append(name)
                continue
            if not self._spread(waiting, last, self._ranks[name]):
                return False
            last, waiting = self._ranks[name], []
        end = min(self._residual.rank[IDLE], last + GAP * (len(waiting) + 1))
        return self._spread(waiting, last, end)

    def _spread(self, names: Sequence[str], low: int, high: int) -> bool:
        if high - low <= len(names):
            return False
        for place, name in enumerate(names, start=1):
            self._ranks[name] = low + (high - low) * place // (len(names) + 1)
        return True

    # -- changes --------------------------------------------------------------------------------

    def apply(self, changes: Changes, visits: int = UNREACHED) -> None:
        """First all that allows more, then all that allows less: so every problem on the way has
        a solution if the last one has.

        Raises InfeasibleError, and TooFarError if that would take more visits to nodes; then this
        object is of no more use.
        """
        residual = self._residual
        residual.visits, residual.most_visits = 0, visits
        for demand in changes.gone_demands:
            self._drop_demand(demand)
        self._make_room(changes)
        for demand, (lower, upper) in changes.bounds.items():
            residual.widen(self._nodes[demand], lower, upper)
        for offered in changes.new_demands:
            self._add_demand(offered)
        for robot, row in changes.new_robots.items():
            self._add_robot(robot, row)
        leaving = [
            number
            for robot, cells in changes.cells.items()
            for number in self._change_row(robot, cells)
        ]
        for offered in changes.new_demands:
            residual.narrow(self._nodes[offered.id], offered.lower, offered.upper)
        for demand, (lower, upper) in changes.bounds.items():
            residual.narrow(self._nodes[demand], lower, upper)
        leaving += [self._numbers.pop(robot) for robot in changes.gone_robots]
        for number in leaving:
            residual.leave(number)
            self._free_numbers.append(number)
        for robot in changes.gone_robots:
            self.assigned.pop(robot, None)
        self._note()

    def _note(self) -> None:
        """Bring `assigned` up to date."""
        residual = self._residual
        for number in residual.moved:
            robot, node = self._names[number], residual.place[number]
            if self._numbers.get(robot) == number:
                if node == IDLE:
                    self.assigned.pop(robot, None)
                else:
                    self.assigned[robot] = self._ids[node]
        residual.moved.clear()

    def _drop_demand(self, demand: str) -> None:
        node = self._nodes.pop(demand)
        self._residual.close(node)
        self._free_nodes.append(node)

    def _add_demand(self, offered: Offered) -> None:
        residual = self._residual
        if self._free_nodes:
            node = self._free_nodes.pop()
        else:
            node = len(self._ids)
            self._ids.append("")
            residual.members.append({})
            for numbers in (residual.lower, residual.upper, residual.required, residual.tie):
                numbers.append(0)
            residual.rank.append(0)
        self._ids[node] = offered.id
        self._nodes[offered.id] = node
        residual.rank[node] = self._ranks[offered.id]
        residual.options.set_column(node, self._column(offered.candidates))
        residual.open(node)
        residual.widen(node, 0, offered.upper)

    def _add_robot(self, robot: str, row: Mapping[str, int]) -> None:
        nodes = self._nodes
        number = self._new_number(robot, {nodes[demand]: p for demand, p in row.items()})
        self._residual.enter(number)

    def _new_number(self, robot: str, row: Mapping[int, int]) -> int:
        residual = self._residual
        if self._free_numbers:
            number = self._free_numbers.pop()
        else:
            number = len(self._names)
            self._names.append("")
            residual.place.append(IDLE)
            residual.shift.append(0)
        self._names[number] = robot
        self._numbers[robot] = number
        residual.shift[number] = self._shifts[robot]
        residual.options.set_robot(number, row)
        return number

    def _change_row(self, robot: str, cells: Mapping[str, int | None]) -> list[int]:
        """The robot by a new number, with the new row. Returns the old one if it is to leave."""
        residual, old = self._residual, self._numbers[robot]
        row = residual.options.row(old)
        for demand, performance in cells.items():
            if performance is None:
                row.pop(self._nodes[demand], None)
            else:
                row[self._nodes[demand]] = performance
        number = self._new_number(robot, row)
        if residual.replace(old, number):
            self._free_numbers.append(old)
            return []
        residual.enter(number)
        return [old]
