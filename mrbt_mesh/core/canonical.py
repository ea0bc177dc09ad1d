"""The canonical one among all optimal assignments: the same whichever solver found one.

All optima differ by moves of robots that cost nothing, around cycles of the demands. So the
residual graph is compressed to one node per demand, one for "unassigned" (idle) and one for the
slack of the bounds. Shortest distances in it, the potentials, prove that the given assignment is
optimal, and tell which moves cost nothing (are *tight*). Robots that have more than one tight
option are fixed one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mrbt_mesh.core.assignment import (
    UNASSIGNED,
    AssignmentProblem,
    Integers,
    Solver,
    SolverError,
    supports_constraints,
)
from mrbt_mesh.core.solvers import cp_sat, default_solver, min_cost_flow

# Of so few robots at a node it is worth while to look anew where they can go.
_FEW = 8


@dataclass(frozen=True, eq=False)
class Optimum:
    """An optimal assignment and what proves it.

    `choice` is a node per robot: a demand's index, or the number of demands for idle. `value` is
    p of that choice, `counts` the robots per node. `potential` is a distance per node, and that
    of the slack as the last one: moving robot i from u to v costs p(i,u) - p(i,v), which with
    potential(u) - potential(v) is never below 0.
    """

    problem: AssignmentProblem
    choice: Integers
    value: Integers
    counts: Integers
    potential: Integers


def solve(problem: AssignmentProblem, solver: Solver) -> tuple[int, ...] | None:
    """The canonical optimum: a demand index or UNASSIGNED per robot; None if infeasible.

    Raises SolverError if the solver fails, or its answer is not an optimum, or wrongly none.
    """
    if not problem.demands:
        return (UNASSIGNED,) * len(problem.robots)
    if problem.constraints:
        return _solve_constrained(problem, solver)
    found = _ask(problem, solver)
    if found is not None:
        return canonical(problem, found)
    if solver not in _TRUSTED and min_cost_flow(problem) is not None:
        raise SolverError("it finds no assignment, but there is one")
    return None


# What these say of there being no assignment is not solved again.
_TRUSTED = (min_cost_flow, default_solver)


def _ask(problem: AssignmentProblem, solver: Solver) -> Sequence[int] | Integers | None:
    try:
        return solver(problem)
    except SolverError:
        raise
    except (Exception, SystemExit) as error:
        raise SolverError(f"it raised {type(error).__name__}: {error}") from error


def _solve_constrained(problem: AssignmentProblem, solver: Solver) -> tuple[int, ...] | None:
    """By CP-SAT, which proves what it finds: another solver's answer is held against that."""
    # For those who use it alone: the library is large.
    from mrbt_mesh.core.cp_sat import first_optimum

    if not supports_constraints(solver):
        raise SolverError("it does not mind side constraints: use cp_sat")
    best = first_optimum(problem)
    if solver not in (cp_sat, default_solver):
        found = _ask(problem, solver)
        if (found is None) != (best is None):
            raise SolverError("it is wrong about whether there is an assignment")
        if found is not None and best is not None:
            choice, _, _ = checked(problem, found)
            given = [UNASSIGNED if d == len(problem.demands) else d for d in choice.tolist()]
            broken = problem.violated(given)
            if broken is not None:
                raise SolverError(f"its assignment breaks the side constraint {broken}")
            if problem.objective(given) != problem.objective(best):
                raise SolverError("the assignment is not optimal: CP-SAT finds a better one")
    return None if best is None else tuple(best)


def canonical(problem: AssignmentProblem, optimum: Sequence[int] | Integers) -> tuple[int, ...]:
    """Among all optimal assignments, the canonical one.

    Robots in sorted order; each takes the first demand, in order, that some optimal
    assignment consistent with the robots before it allows; unassigned comes last.
    Raises SolverError if `optimum` breaks a bound or is not optimal.
    """
    choice = first_optimum(proven(problem, optimum))
    idle = len(problem.demands)
    return tuple([UNASSIGNED if node == idle else node for node in choice])


def proven(problem: AssignmentProblem, optimum: Sequence[int] | Integers) -> Optimum:
    """Check that an assignment is feasible and optimal. Raises SolverError if it is not."""
    choice, value, counts = checked(problem, optimum)
    return Optimum(problem, choice, value, counts, _potentials(problem, choice, value, counts))


def checked(
    problem: AssignmentProblem, answer: Sequence[int] | Integers
) -> tuple[Integers, Integers, Integers]:
    """An assignment that keeps the bounds, as in Optimum: (choice, value, counts).

    Raises SolverError if it does not keep them, or is no assignment at all.
    """
    idle, given = len(problem.demands), _as_integers(answer)
    if len(given) != len(problem.robots):
        raise SolverError(f"{len(given)} answers for {len(problem.robots)} robots")
    unassigned = given == UNASSIGNED
    choice = np.where(unassigned, idle, given)
    chosen = problem.pair_demand == choice[problem.pair_robot]
    value = np.zeros(len(choice), np.int64)
    value[problem.pair_robot[chosen]] = problem.pair_performance[chosen]
    # Whatever is out of range, or cannot be done, is in no pair.
    if np.count_nonzero(chosen) + np.count_nonzero(unassigned) != len(choice):
        raise _impossible(problem, given)
    counts = np.bincount(choice, minlength=idle + 1)
    wrong = (counts < problem.lower) | (counts > problem.upper)
    if wrong.any():
        demand = int(wrong.argmax())
        bounds = problem.demands[demand]
        count = counts[demand]
        raise SolverError(f"{count} robots on {bounds.id}, {bounds.lower}..{bounds.upper}")
    return choice, value, counts


def _as_integers(answer: Sequence[int] | Integers) -> Integers:
    """What a solver returned, which may be anything. Raises SolverError if it is no answer."""
    try:
        given = np.asarray(answer)
        if given.ndim == 1 and (given.dtype.kind == "i" or not len(given)):
            return given.astype(np.int64, copy=False)
    except (ValueError, TypeError, OverflowError):
        pass  # not even an array
    shown = repr(answer)
    raise SolverError(f"one whole number per robot is expected, it returned {shown:.80}")


def _impossible(problem: AssignmentProblem, given: Integers) -> SolverError:
    for name, performance, demand in zip(
        problem.robots, problem.performance, given.tolist(), strict=True
    ):
        if demand != UNASSIGNED and not 0 <= demand < len(problem.demands):
            return SolverError(f"{name}: no demand {demand}")
        if demand != UNASSIGNED and demand not in performance:
            return SolverError(f"{name} cannot do {problem.demands[demand].id}")
    return SolverError("a robot and a demand are paired twice")


def _potentials(
    problem: AssignmentProblem, choice: Integers, value: Integers, counts: Integers
) -> Integers:
    """Bellman-Ford; a cycle that gains is a proof that the assignment was not optimal."""
    idle = len(problem.demands)
    slack = idle + 1
    robots = problem.pair_robot
    gives, takes = (counts > problem.lower).nonzero()[0], (counts < problem.upper).nonzero()[0]
    to_slack, from_slack = np.full(len(takes), slack), np.full(len(gives), slack)
    sources = np.concatenate((choice[robots], choice, takes, from_slack))
    targets = np.concatenate((problem.pair_demand, np.full(len(choice), idle), to_slack, gives))
    costs = np.zeros(len(sources), np.int64)
    np.subtract(value[robots], problem.pair_performance, out=costs[: len(robots)])
    costs[len(robots) : len(robots) + len(choice)] = value
    distance = np.zeros(slack + 1, np.int64)
    for _ in range(slack + 2):
        before = distance.copy()
        np.minimum.at(distance, targets, before[sources] + costs)
        if distance.tobytes() == before.tobytes():
            return distance
    raise SolverError("the assignment is not optimal: moving robots around a cycle gains")


def first_optimum(found: Optimum) -> list[int]:
    """The canonical choice, a node per robot."""
    problem, potential = found.problem, found.potential
    idle = len(problem.demands)
    level = found.value + potential[found.choice]
    gain = problem.pair_performance + potential[problem.pair_demand]
    tight = np.flatnonzero(gain == level[problem.pair_robot])
    robots, demands = problem.pair_robot[tight], problem.pair_demand[tight]
    may_idle = level == potential[idle]
    free = np.bincount(robots, minlength=len(level)) + may_idle > 1
    kept = free[robots]
    robots, demands = robots[kept], demands[kept]
    if not len(robots):
        return list(found.choice.tolist())
    masks = dict.fromkeys(np.flatnonzero(free).tolist(), 0)
    wanting: list[list[int]] = [[] for _ in range(idle + 2)]
    if len(robots) <= 2 * _FEW * idle:
        for robot, demand in zip(robots.tolist(), demands.tolist(), strict=True):
            masks[robot] |= 1 << demand
            wanting[demand].append(robot)
    else:
        table = np.zeros((len(level), idle), np.bool_)
        table[robots, demands] = True
        lines = np.packbits(table[free], axis=1, bitorder="little")
        masks = dict(
            zip(masks, (int.from_bytes(x.tobytes(), "little") for x in lines), strict=True)
        )
    for robot in np.flatnonzero(free & may_idle).tolist():
        masks[robot] |= 1 << idle
    return _Ties(found, masks, wanting).resolve()


class _Ties:
    """Fixes the robots that have several tight options, in order. Sets of nodes are bit masks.

    `ahead[u]` are the nodes to which some robot at u that is not fixed could move, or which take
    a robot more through the slack; it may still name a node to which nobody can move any more.
    `wanting[u]` are the robots that u is an option of; where they are many none are named.
    `cells` part the nodes: ways never lead back from one cell to another one that they have left.
    """

    def __init__(self, found: Optimum, options: dict[int, int], wanting: list[list[int]]) -> None:
        problem = found.problem
        self._wanting = wanting
        self._options = options
        self._slack = len(problem.demands) + 1
        self._bits = [1 << node for node in range(self._slack + 1)]
        self._choice: list[int] = found.choice.tolist()
        self._counts: list[int] = found.counts.tolist()
        self._lower: list[int] = problem.lower.tolist()
        self._upper: list[int] = problem.upper.tolist()
        self._level: list[bool] = (found.potential == found.potential[-1]).tolist()
        self._movable: list[list[int]] = [[] for _ in range(self._slack)]
        for robot in options:
            self._movable[self._choice[robot]].append(robot)
        self._ahead = [0] * (self._slack + 1)
        for node in range(self._slack):
            if self._movable[node] or self._level[node]:
                self._look_ahead(node)
        self._cell = [0] * (self._slack + 1)
        self._cells = [(1 << (self._slack + 1)) - 1]

    def resolve(self) -> list[int]:
        for robot, options in self._options.items():
            here = self._choice[robot]
            movable = self._movable[here]
            movable.remove(robot)
            before = options & (self._bits[here] - 1)
            if len(movable) < _FEW:
                self._look_ahead(here)
            while better := before & self._cells[self._cell[here]]:
                first = (better & -better).bit_length() - 1
                way = self._way(robot, first, here)
                if way is not None:
                    self._rotate(robot, way)
                    break
        return self._choice

    def _look_ahead(self, node: int) -> None:
        """Where the robots at a node can go, and what its bounds leave room for."""
        mask = 0
        for robot in self._movable[node]:
            mask |= self._options[robot]
        self._ahead[node] = mask & ~self._bits[node]
        self._mind_bounds(node)

    def _mind_bounds(self, node: int) -> None:
        if self._level[node]:
            slack, bit = self._slack, self._bits[node]
            if self._counts[node] < self._upper[node]:
                self._ahead[node] |= self._bits[slack]
            else:
                self._ahead[node] &= ~self._bits[slack]
            if self._counts[node] > self._lower[node]:
                self._ahead[slack] |= bit
            else:
                self._ahead[slack] &= ~bit

    def _way(self, robot: int, start: int, end: int) -> list[tuple[int, int, int]] | None:
        """Moves (mover, from, to) that lead from `start` to `end`, mover -1 through the slack.

        The movers come after `robot`.

        Where there are none, whatever `start` reaches becomes a cell of its own.
        """
        while True:
            nodes = self._search(robot, start, end)
            if nodes is None:
                return None
            moves = []
            for here, there in pairwise(nodes):
                mover = self._mover(here, there)
                if mover is None:
                    self._ahead[here] &= ~self._bits[there]
                    break
                moves.append((mover, here, there))
            else:
                return moves

    def _mover(self, here: int, there: int) -> int | None:
        if self._slack in (here, there):
            return -1
        bit = self._bits[there]
        return next((r for r in self._movable[here] if self._options[r] & bit), None)

    def _search(self, robot: int, start: int, end: int) -> list[int] | None:
        """The nodes of a way, breadth first."""
        ahead, cell = self._ahead, self._cell[start]
        last, goals = self._before(robot, end)
        if start in last:
            return [start, *_follow(last, start)]
        unseen = self._cells[cell] & ~self._bits[start]
        queue, found = [start], [0]
        for node in queue:
            fresh = ahead[node] & unseen
            found.append(fresh)
            if not fresh:
                continue
            if goal := fresh & goals:
                break
            unseen &= ~fresh
            while fresh:
                bit = fresh & -fresh
                fresh ^= bit
                queue.append(bit.bit_length() - 1)
        else:
            self._part(queue, cell)
            return None
        at = len(found) - 2
        met = goal.bit_length() - 1
        way = [*reversed(_follow(last, met)), met]
        while True:
            node = queue[at]
            way.append(node)
            if node == start:
                way.reverse()
                return way
            bit = self._bits[node]
            while not found[at] & bit:
                at -= 1
            at -= 1

    def _before(self, robot: int, end: int) -> tuple[dict[int, int], int]:
        """Some nodes that lead to `end`, each with the next one, and as a mask: two steps back,
        where few robots are to be asked for them.
        """
        last, goals, layer = {end: end}, self._bits[end], [end]
        for _ in range(2):
            layer, nodes = [], layer
            for node in nodes:
                for mover in self._wanting[node]:
                    here = self._choice[mover]
                    if mover > robot and here not in last:
                        last[here] = node
                        goals |= self._bits[here]
                        layer.append(here)
        return last, goals

    def _part(self, nodes: list[int], cell: int) -> None:
        new, mask = len(self._cells), 0
        for node in nodes:
            mask |= self._bits[node]
            self._cell[node] = new
        self._cells.append(mask)
        self._cells[cell] &= ~mask

    def _rotate(self, robot: int, way: list[tuple[int, int, int]]) -> None:
        """Move a robot, now fixed, to the start of a way that leads to where it was."""
        start, end = way[0][1], way[-1][2]
        self._choice[robot] = start
        self._counts[end] -= 1
        self._counts[start] += 1
        for mover, here, there in way:
            if mover >= 0:
                self._movable[here].remove(mover)
                self._movable[there].append(mover)
                self._choice[mover] = there
                self._counts[here] -= 1
                self._counts[there] += 1
                self._ahead[there] |= self._options[mover] & ~self._bits[there]
        for node in (end, *(here for _, here, _ in way)):
            if node != self._slack:
                if len(self._movable[node]) < _FEW:
                    self._look_ahead(node)
                else:
                    self._mind_bounds(node)


def _follow(following: dict[int, int], node: int) -> list[int]:
    """The nodes after `node`, each followed by its entry, to the one that is its own."""
    way = []
    while following[node] != node:
        node = following[node]
        way.append(node)
    return way
