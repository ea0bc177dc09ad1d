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
from functools import cached_property
from itertools import pairwise

import numpy as np

from mrbt_mesh.core.assignment.problem import (
    UNASSIGNED,
    AssignmentProblem,
    Integers,
    Solver,
    SolverError,
    supports_constraints,
)
from mrbt_mesh.core.assignment.solvers import cp_sat, default_solver, min_cost_flow

# Costs more than any way, and no sum of it and a way's cost is too large.
_CLOSED = 1 << 61
# Where so few robots can leave a node, it is worth while to look anew where they can go.
_FEW = 8
# A search that has seen so many nodes is met from its end, by a step more each time that it has
# grown so many times.
_MANY = 16
_GROWTH = 4


@dataclass(frozen=True, eq=False)
class ProvenOptimum:
    """An optimal assignment and what proves it.

    `choice` is a node per robot: a demand's index, or the number of demands for idle; `counts`
    are the robots per node. `potential` is a distance per node, and that of the slack as the last
    one: moving robot i from u to v costs p(i,u) - p(i,v), which with potential(u) - potential(v)
    is never below 0. `tight` are those of the problem's options for which it is 0.
    """

    problem: AssignmentProblem
    choice: Integers
    counts: Integers
    potential: Integers
    tight: Integers


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
    from mrbt_mesh.core.assignment.cp_sat import first_optimum

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


def proven(problem: AssignmentProblem, optimum: Sequence[int] | Integers) -> ProvenOptimum:
    """Check that an assignment is feasible and optimal. Raises SolverError if it is not.

    By Bellman-Ford: a cycle that gains is a proof that the assignment was not optimal.
    """
    choice, counts, chosen = checked(problem, optimum)
    robots, nodes, performances = problem.options
    value = np.empty(len(choice), np.int64)
    value[robots[chosen]] = performances[chosen]
    slack, options = len(counts), len(nodes)
    every, to_slack = np.arange(slack), np.empty(slack, np.int64)
    to_slack.fill(slack)
    shut = np.concatenate((counts >= problem.upper, counts <= problem.lower))
    sources = np.concatenate((choice[robots], every, to_slack))
    targets = np.concatenate((nodes, to_slack, every))
    costs = np.concatenate((value[robots] - performances, shut * _CLOSED))
    distance = np.zeros(slack + 1, np.int64)
    reached = np.empty(len(sources), np.int64)
    for _ in range(slack + 2):
        distance.take(sources, out=reached, mode="clip")
        reached += costs
        nearer = distance.copy()
        np.minimum.at(nearer, targets, reached)
        if nearer.tobytes() == distance.tobytes():
            tight = (reached[:options] == distance[nodes]).nonzero()[0]
            return ProvenOptimum(problem, choice, counts, distance, tight)
        distance = nearer
    raise SolverError("the assignment is not optimal: moving robots around a cycle gains")


def checked(
    problem: AssignmentProblem, answer: Sequence[int] | Integers
) -> tuple[Integers, Integers, Integers]:
    """An assignment that keeps the bounds: choice, counts (as in ProvenOptimum), chosen options.

    Raises SolverError if it does not keep them, or is no assignment at all.
    """
    idle, given = len(problem.demands), _as_integers(answer)
    if len(given) != len(problem.robots):
        raise SolverError(f"{len(given)} answers for {len(problem.robots)} robots")
    unassigned = (given == UNASSIGNED).nonzero()[0]
    choice = given.copy()
    choice[unassigned] = idle
    robots, nodes, _ = problem.options
    chosen = (choice[robots] == nodes).nonzero()[0]
    # Whatever is out of range, or cannot be done, is no option.
    if len(chosen) != len(choice):
        raise _impossible(problem, given)
    counts = np.bincount(choice, minlength=idle + 1)
    if counts[idle] != len(unassigned):  # idle goes by another number in answers
        raise _impossible(problem, given)
    wrong = (counts < problem.lower) | (counts > problem.upper)
    if np.count_nonzero(wrong):
        demand = int(wrong.argmax())
        bounds = problem.demands[demand]
        count = counts[demand]
        raise SolverError(f"{count} robots on {bounds.id}, {bounds.lower}..{bounds.upper}")
    return choice, counts, chosen


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


def first_optimum(found: ProvenOptimum) -> list[int]:
    """The canonical choice, a node per robot."""
    problem = found.problem
    robots, nodes, _ = problem.options
    # Where moves through the slack cost nothing: how many robots more or less a node may have.
    level = found.potential[:-1] == found.potential[-1]
    more = (level * (problem.upper - found.counts)).tolist()
    less = (level * (found.counts - problem.lower)).tolist()
    choice: list[int] = found.choice.tolist()
    return first_of_ties(choice, robots[found.tight], nodes[found.tight], more, less)


def first_of_ties(
    choice: list[int], robots: Integers, nodes: Integers, more: list[int], less: list[int]
) -> list[int]:
    """The canonical choice, a node per robot, from any optimal one; that may be changed.

    `robots` and `nodes` are the tight options. `more` and `less` are how many robots more or less
    a node may have where that costs nothing.
    """
    several = np.bincount(robots, minlength=len(choice)) > 1
    free: list[int] = several.nonzero()[0].tolist()
    if not free:
        return choice
    if len(free) < len(choice):
        kept = several[robots]
        robots, nodes = robots[kept], nodes[kept]
    return _Ties(choice, free, robots, nodes, more, less).resolve()


class _Ties:
    """Fixes the robots that have several tight options, in order. Sets of nodes are bit masks.

    `through[u]` is the slack if that takes a robot of u, or nothing; `through[slack]` are the
    nodes which it can give one. `ahead[u]` adds the nodes to which some robot at u that is not
    fixed could move; it may still name one to which nobody can move any more. `cells` part the
    nodes: ways never lead back from one cell to another one that they have left.
    """

    def __init__(
        self,
        choice: list[int],
        free: list[int],
        robots: Integers,
        nodes: Integers,
        more: list[int],
        less: list[int],
    ) -> None:
        """`robots` and `nodes` are the tight options of those robots that are free to choose."""
        self._slack = slack = len(more)
        self._bits = bits = [1 << node for node in range(slack + 1)]
        self._tight = robots, nodes
        self._options = _masks(free, robots, nodes, slack)
        self._choice = choice
        _sorted_alike(self._choice, self._options)
        self._more, self._less = more, less
        self._through = [bits[slack] if count else 0 for count in more]
        self._through.append(sum(bit for bit, count in zip(bits, less, strict=False) if count))
        self._movable: list[list[int]] = [[] for _ in bits]
        self._ahead = self._through.copy()
        for robot, options in self._options.items():
            node = self._choice[robot]
            self._movable[node].append(robot)
            self._ahead[node] |= options
        self._cell = [0] * (slack + 1)
        self._cells = [(1 << (slack + 1)) - 1]
        self._parent = [0] * (slack + 1)

    def resolve(self) -> list[int]:
        bits, choice, movable, ahead = self._bits, self._choice, self._movable, self._ahead
        cell, cells, masks, through = self._cell, self._cells, self._options, self._through
        for robot, options in masks.items():
            here = choice[robot]
            goal = bits[here]
            if cells[cell[here]] == goal:
                continue
            leaving = movable[here]
            leaving.remove(robot)
            if len(leaving) < _FEW:
                mask = through[here]
                for mover in leaving:
                    mask |= masks[mover]
                ahead[here] = mask
            before = options & (goal - 1)
            while better := before & cells[cell[here]]:
                start = (better & -better).bit_length() - 1
                way = [here, start] if ahead[start] & goal else self._search(robot, start, here)
                if way and self._rotate(robot, way):
                    break
        return choice

    def _search(self, robot: int, start: int, end: int) -> list[int] | None:
        """The nodes of a way from `start` to `end` by robots after `robot`, the last one first.

        Breadth first. Where there is none, whatever `start` reaches becomes a cell of its own.
        """
        ahead, parent, goals = self._ahead, self._parent, self._bits[end]
        cell = self._cell[start]
        unseen = self._cells[cell] ^ self._bits[start]
        parent[start] = start
        queue, after = [start], {end: end}
        many, steps = _MANY, 0
        for node in queue:
            fresh = ahead[node] & unseen
            unseen ^= fresh
            while fresh:
                bit = fresh & -fresh
                fresh ^= bit
                seen = bit.bit_length() - 1
                parent[seen] = node
                if ahead[seen] & goals:
                    return self._joined(seen, goals, after)
                queue.append(seen)
            if len(queue) > many:
                many, steps = many * _GROWTH, steps + 1
                after, goals = self._before(robot, start, end, steps)
                for seen in queue:
                    if ahead[seen] & goals:
                        return self._joined(seen, goals, after)
        for node in queue:
            self._cell[node] = len(self._cells)
        self._cells.append(self._cells[cell] ^ unseen)
        self._cells[cell] = unseen
        return None

    def _joined(self, met: int, goals: int, after: dict[int, int]) -> list[int]:
        """The way to `met`, from where it was searched, on to a goal, and as that leads on."""
        goal = (self._ahead[met] & goals).bit_length() - 1
        way, parent = [goal], self._parent
        while (node := after[goal]) != goal:
            way.append(node)
            goal = node
        way.reverse()
        way.append(met)
        while (node := parent[met]) != met:
            way.append(node)
            met = node
        return way

    def _before(self, robot: int, start: int, end: int, steps: int) -> tuple[dict[int, int], int]:
        """The nodes from which robots after `robot` lead to `end` in so many steps, not by `start`.

        Each with the next one, and all as a mask.
        """
        after, layer = {start: start, end: end}, [end]
        for _ in range(steps):
            nodes, layer = layer, []
            for node in nodes:
                for mover in self._wanting(node):
                    here = self._choice[mover]
                    if mover > robot and here not in after:
                        after[here] = node
                        layer.append(here)
        del after[start]
        goals = 0
        for node in after:
            goals |= self._bits[node]
        return after, goals

    def _wanting(self, node: int) -> list[int]:
        """The robots of which it is an option."""
        robots, ends = self._by_node
        wanting: list[int] = robots[ends[node] : ends[node + 1]].tolist()
        return wanting

    @cached_property
    def _by_node(self) -> tuple[Integers, list[int]]:
        """The robots of all options, node by node, and where those of a node begin."""
        robots, nodes = self._tight
        counts = np.bincount(nodes, minlength=len(self._bits))
        small = nodes.astype(np.min_scalar_type(len(counts)))  # sorted faster
        return robots[small.argsort(kind="stable")], [0, *counts.cumsum().tolist()]

    def _rotate(self, robot: int, way: list[int]) -> bool:
        """Move a robot, now fixed, to where a way starts, and others along it to where it was.

        The way is given last node first. It is not gone if there is nobody to move from some
        node to the next: that is noted.
        """
        bits, options, movable, ahead = self._bits, self._options, self._movable, self._ahead
        movers = []
        for there, here in pairwise(way):
            bit = bits[there]
            if self._through[here] & bit:
                movers.append(-1)
                continue
            for mover in movable[here]:
                if options[mover] & bit:
                    movers.append(mover)
                    break
            else:
                ahead[here] &= ~bit
                return False
        self._choice[robot] = way[-1]
        for mover, there, here in zip(movers, way, way[1:], strict=False):
            if mover < 0:
                self._pass(here, there)
            else:
                movable[here].remove(mover)
                movable[there].append(mover)
                self._choice[mover] = there
                ahead[there] |= options[mover]
        for node in way:
            leaving = movable[node]
            if len(leaving) < _FEW:
                mask = self._through[node]
                for mover in leaving:
                    mask |= options[mover]
                ahead[node] = mask
        return True

    def _pass(self, here: int, there: int) -> None:
        """The slack takes a robot from one node, or gives one to the other."""
        slack = self._slack
        node, change = (here, 1) if there == slack else (there, -1)
        self._more[node] -= change
        self._less[node] += change
        self._through[node] = self._bits[slack] if self._more[node] else 0
        self._through[slack] &= ~self._bits[node]
        if self._less[node]:
            self._through[slack] |= self._bits[node]
        self._ahead[node] |= self._through[node]
        self._ahead[slack] |= self._through[slack]


def _masks(free: list[int], robots: Integers, nodes: Integers, count: int) -> dict[int, int]:
    """Per free robot its nodes, of so many, as a mask."""
    width = -(-count // 64) * 64
    table = np.zeros((free[-1] + 1) * width, np.bool_)
    table[robots * width + nodes] = True
    packed = np.packbits(table, bitorder="little")
    if width == 64:
        return dict(zip(free, packed.view("<u8")[free].tolist(), strict=True))
    size, lines, convert = width // 8, packed.tobytes(), int.from_bytes
    return {robot: convert(lines[robot * size : (robot + 1) * size], "little") for robot in free}


def _sorted_alike(choice: list[int], options: dict[int, int]) -> None:
    """Robots with the same options exchange places, which costs nothing: the first the first.

    Where there are few such robots, ways are found as fast.
    """
    if 2 * len(set(options.values())) > len(options):
        return
    alike: dict[int, list[int]] = {}
    for robot, mask in options.items():
        alike.setdefault(mask, []).append(robot)
    for robots in alike.values():
        places = sorted([choice[robot] for robot in robots])
        for robot, place in zip(robots, places, strict=True):
            choice[robot] = place
