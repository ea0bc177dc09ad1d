"""The assignment problem in OR-tools' CP-SAT: exact, with side constraints.

CP-SAT may find any optimum, and another one in its next version. With side constraints the
canonical one is therefore asked for by name: the objective and then the robots' choices, in order,
are the digits of one number, which is maximised, in as few pieces as it fits into.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ortools.sat.python import cp_model

from mrbt_mesh.core.assignment.problem import UNASSIGNED, AssignmentProblem, Limit, SolverError

# Numbers up to here are exact wherever CP-SAT computes with doubles.
LARGEST = 1 << 52


@dataclass(frozen=True, slots=True)
class _Digit:
    """One digit of the number that is maximised: the sum of variable * weight, below `size`.

    `robot` -1 means the objective.
    """

    robot: int
    terms: list[tuple[cp_model.IntVar, int]]
    size: int


def optimum(problem: AssignmentProblem) -> list[int] | None:
    """Some optimal assignment: a demand's index or UNASSIGNED per robot; None if infeasible."""
    model = _Model(problem)
    return model.maximise(model.total.terms)


def is_feasible(problem: AssignmentProblem) -> bool:
    """Whether any assignment keeps the bounds and the side constraints."""
    return _Model(problem).maximise([]) is not None


def first_optimum(problem: AssignmentProblem) -> list[int] | None:
    """The canonical optimum, None if infeasible.

    Robots in sorted order; each takes the first demand, in order, that some optimal assignment
    consistent with the robots before it allows; unassigned comes last.
    """
    model = _Model(problem)
    found: list[int] | None = None
    for block in model.blocks():
        place, terms = 1, []
        for digit in reversed(block):
            terms += [(variable, weight * place) for variable, weight in digit.terms]
            place *= digit.size
        found = model.maximise(terms)
        if found is None:
            return None
        model.keep(found, [digit.robot for digit in block])
    return found


class _Model:
    """One variable per robot and demand that it can do."""

    def __init__(self, problem: AssignmentProblem) -> None:
        self._problem = problem
        self._model = model = cp_model.CpModel()
        self._rows: list[dict[int, cp_model.IntVar]] = [{} for _ in problem.robots]
        columns: list[list[cp_model.IntVar]] = [[] for _ in problem.demands]
        for robot, row in enumerate(problem.performance):
            for demand in row:
                variable = model.new_bool_var("")
                self._rows[robot][demand] = variable
                columns[demand].append(variable)
            if len(row) > 1:
                model.add_at_most_one(self._rows[robot].values())
        for bounds, column in zip(problem.demands, columns, strict=True):
            if bounds.lower > len(column):
                model.add_bool_or([])
            elif bounds.lower > 0 or bounds.upper < len(column):
                model.add_linear_constraint(sum(column), bounds.lower, bounds.upper)
        self._restrict(columns)
        values = [value for row in problem.performance for value in row.values()]
        # Performances in the largest unit that keeps them whole: small numbers are solved faster.
        self._unit = math.gcd(*values) or 1
        terms = [
            (variable, problem.performance[robot][demand] // self._unit)
            for robot, row in enumerate(self._rows)
            for demand, variable in row.items()
        ]
        rows = [row.values() for row in problem.performance]
        span = sum(max(0, *row) - min(0, *row) for row in rows if row) // self._unit
        self.total = _Digit(-1, terms, span + 1)

    def _restrict(self, columns: Sequence[Sequence[cp_model.IntVar]]) -> None:
        model = self._model
        for constraint in self._problem.constraints:
            if isinstance(constraint, Limit):
                rows = [self._rows[robot] for robot in constraint.robots]
                counted = [row[d] for row in rows for d in constraint.demands if d in row]
                if constraint.count < len(counted):
                    model.add(sum(counted) <= constraint.count)
                continue
            used = []
            for group in constraint.groups:
                used.append(model.new_bool_var(""))
                for variable in (v for demand in group for v in columns[demand]):
                    model.add_implication(variable, used[-1])
            if constraint.count < len(used):
                model.add(sum(used) <= constraint.count)

    def blocks(self) -> Iterator[list[_Digit]]:
        """The objective and then the robots, in groups that fit into one number.

        A robot's digit is greatest for its first demand, and 0 for none.
        """
        block, room = [self.total], LARGEST // self.total.size
        for robot, row in enumerate(self._rows):
            digit = _Digit(
                robot, [(v, len(row) - i) for i, v in enumerate(row.values())], len(row) + 1
            )
            if digit.size > room:
                yield block
                block, room = [], LARGEST
            block.append(digit)
            room //= digit.size
        yield block

    def keep(self, choice: Sequence[int], robots: Sequence[int]) -> None:
        """From now on these robots' choices, or (-1) the objective, are as in `choice`."""
        for robot in robots:
            if robot < 0:
                best = self._problem.objective(choice) // self._unit
                self._model.add_linear_constraint(_sum(self.total.terms), best, best)
                continue
            for demand, variable in self._rows[robot].items():
                self._model.add(variable == int(choice[robot] == demand))
        self._model.clear_hints()  # type: ignore[no-untyped-call]
        for robot, row in enumerate(self._rows):
            for demand, variable in row.items():
                self._model.add_hint(variable, choice[robot] == demand)

    def maximise(self, terms: Sequence[tuple[cp_model.IntVar, int]]) -> list[int] | None:
        """An assignment that is proved to be best, None if there is none at all."""
        if terms:
            self._model.maximize(_sum(terms))
        solver = cp_model.CpSolver()
        solver.parameters.num_workers = 1
        solver.parameters.random_seed = 0
        solver.parameters.linearization_level = 2
        # Its gap is a double: with large numbers, it could be 0 before the best is found.
        solver.parameters.absolute_gap_limit = 0
        status = solver.solve(self._model)
        if status == cp_model.INFEASIBLE:
            return None
        if status != cp_model.OPTIMAL:
            raise SolverError(f"CP-SAT ended with status {solver.status_name(status)}, not a proof")
        choice = [UNASSIGNED] * len(self._rows)
        for robot, row in enumerate(self._rows):
            for demand, variable in row.items():
                if solver.boolean_value(variable):
                    choice[robot] = demand
        return choice


def _sum(terms: Sequence[tuple[cp_model.IntVar, int]]) -> cp_model.LinearExprT:
    return cp_model.LinearExpr.weighted_sum([v for v, _ in terms], [w for _, w in terms])
