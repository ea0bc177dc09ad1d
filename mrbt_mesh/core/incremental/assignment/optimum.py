"""The canonical optimum of an assignment problem, by ids, and changes to it.

Robots and demands have names here; `Residual` works on their numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem
from mrbt_mesh.core.assignment.problem import SolverError
from mrbt_mesh.core.incremental.assignment.arc_costs import (
    ENTRY,
    IDLE,
    MAX_DISTANCE,
    UNREACHED,
    DenseOptions,
    Options,
    SparseOptions,
)
from mrbt_mesh.core.incremental.assignment.prices import set_prices
from mrbt_mesh.core.incremental.assignment.problem_changes import ProblemChanges
from mrbt_mesh.core.incremental.assignment.residual import Residual
from mrbt_mesh.core.incremental.assignment.ties import break_ties

# Share of the (robot, demand) pairs from which a matrix is the faster way to store them.
DENSE = 0.25


class Optimum:
    """`assigned` is the canonical optimum: robot -> demand, without the robots that are idle.

    `pairs`: of a robot and a demand that it can do, at the beginning.
    """

    def __init__(self, team: NamedProblem, assigned: Mapping[str, str]) -> None:
        """Raises SolverError if `assigned` is not canonical."""
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
            members=members,
            lower=[0, 0, *(demand.lower for demand in demands)],
            upper=[0, 0, *(demand.upper for demand in demands)],
            required=[0, 0, *map(len, members[ENTRY + 1 :])],
        )
        self._positions = {demand.id: position for position, demand in enumerate(demands)}
        set_prices(self._residual)
        self._break_ties()
        if self._residual.moved:
            raise SolverError("the optimum is not the canonical one")

    def _options(self, demands: Sequence[NamedDemand]) -> Options:
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

    # -- changes --------------------------------------------------------------------------------

    def apply(self, changes: ProblemChanges, visits: int = UNREACHED) -> None:
        """Raises InfeasibleError, and TooFarError if that would take more visits to nodes; then
        this object is of no more use.
        """
        residual = self._residual
        residual.visits, residual.most_visits = 0, visits
        if changes.order:
            self._positions = {demand: place for place, demand in enumerate(changes.order)}
        for demand in changes.gone_demands:
            self._drop_demand(demand)
        for robot in changes.gone_robots:
            self.assigned.pop(robot, None)
            self._leave(self._numbers.pop(robot))
        for robot, cells in changes.cells.items():
            self._change_row(robot, cells)
        for demand, (lower, upper) in changes.bounds.items():
            residual.widen(self._nodes[demand], lower, upper)
        for offered in changes.new_demands:
            self._add_demand(offered)
        for robot, row in changes.new_robots.items():
            self._add_robot(robot, row)
        for demand, (lower, upper) in changes.bounds.items():
            residual.narrow(self._nodes[demand], lower, upper)
        residual.settle()
        for offered in changes.new_demands:
            residual.widen(self._nodes[offered.id], offered.lower, offered.upper)
        self._break_ties()
        self._note()

    def _break_ties(self) -> None:
        positions, ids = self._positions, self._ids
        break_ties(
            self._residual,
            self._names,
            lambda node: len(positions) if node == IDLE else positions[ids[node]],
        )

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

    def _add_demand(self, offered: NamedDemand) -> None:
        residual = self._residual
        if self._free_nodes:
            node = self._free_nodes.pop()
        else:
            node = len(self._ids)
            self._ids.append("")
            residual.members.append({})
            for numbers in (residual.lower, residual.upper, residual.required):
                numbers.append(0)
        self._ids[node] = offered.id
        self._nodes[offered.id] = node
        residual.options.set_column(node, self._column(offered.candidates))
        residual.open(node, offered.lower)

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
        self._names[number] = robot
        self._numbers[robot] = number
        residual.options.set_robot(number, row)
        return number

    def _change_row(self, robot: str, cells: Mapping[str, int | None]) -> None:
        """The robot by a new number, with the new row."""
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
        else:
            residual.enter(number)
            self._leave(old)

    def _leave(self, number: int) -> None:
        self._residual.leave(number)
        self._free_numbers.append(number)
