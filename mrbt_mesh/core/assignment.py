"""*Assign Agents*: the exact and canonical solution of the paper's problem (2).

Maximise the sum of p(i, l) r(i, l) within the bounds of each demand, at most one demand per
robot, in integers. A solver finds some optimum; `canonical` turns it into the one that the
order of robots and demands names, so that the answer is the same whichever solver, version
or processor found it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

UNASSIGNED = -1


@dataclass(frozen=True, slots=True)
class Bounds:
    """One demand: between `lower` and `upper` robots."""

    id: str
    lower: int
    upper: int


@dataclass(frozen=True, slots=True)
class AssignmentProblem:
    """Robots in sorted order, demands in order of preference.

    `performance[i]` maps a demand's index to p of robot i in micro-units; absent: cannot.
    """

    robots: tuple[str, ...]
    demands: tuple[Bounds, ...]
    performance: tuple[Mapping[int, int], ...]

    def objective(self, choice: Sequence[int]) -> int:
        """The sum of performances of an assignment, in micro-units."""
        return sum(self.performance[i][d] for i, d in enumerate(choice) if d != UNASSIGNED)


# A solver returns one demand index per robot (UNASSIGNED for none), or None if infeasible.
Solver: TypeAlias = Callable[[AssignmentProblem], Sequence[int] | None]


class SolverError(RuntimeError):
    """A solver broke its contract: its answer is not feasible or not optimal."""


def solve(problem: AssignmentProblem, solver: Solver) -> tuple[int, ...] | None:
    """The canonical optimum: a demand index or UNASSIGNED per robot; None if infeasible.

    Raises SolverError if the solver's answer is not an optimum.
    """
    if not problem.demands:
        return (UNASSIGNED,) * len(problem.robots)
    found = solver(problem)
    return None if found is None else canonical(problem, found)


def canonical(problem: AssignmentProblem, optimum: Sequence[int]) -> tuple[int, ...]:
    """Among all optimal assignments, the canonical one.

    Robots in sorted order; each takes the first demand, in order, that some optimal
    assignment consistent with the robots before it allows; unassigned comes last.

    All optima differ by moves of zero reduced cost around cycles of the demands (with
    "unassigned" as one more, and a slack node where bounds leave room). So the robots are
    fixed one after the other, each at its first choice from which such moves lead back.
    Raises SolverError if `optimum` breaks a bound or is not optimal.
    """
    return _Canonical(problem, list(optimum)).run()


class _Canonical:
    """Nodes 0..T-1 are the demands, T is "unassigned", T+1 the slack of the bounds."""

    def __init__(self, problem: AssignmentProblem, choice: list[int]) -> None:
        self.problem = problem
        self.idle = len(problem.demands)
        self.slack = self.idle + 1
        if len(choice) != len(problem.robots):
            raise SolverError(f"{len(choice)} answers for {len(problem.robots)} robots")
        for name, performance, demand in zip(
            problem.robots, problem.performance, choice, strict=True
        ):
            if demand != UNASSIGNED and demand not in performance:
                if not 0 <= demand < self.idle:
                    raise SolverError(f"{name}: no demand {demand}")
                raise SolverError(f"{name} cannot do {problem.demands[demand].id}")
        self.choice = [self.idle if d == UNASSIGNED else d for d in choice]
        self.counts = [self.choice.count(demand) for demand in range(self.idle + 1)]
        for demand, bounds in enumerate(problem.demands):
            if not bounds.lower <= self.counts[demand] <= bounds.upper:
                count = self.counts[demand]
                raise SolverError(f"{count} robots on {bounds.id}, {bounds.lower}..{bounds.upper}")
        self.options = [
            {**performance, self.idle: 0} for performance in map(dict, problem.performance)
        ]
        self.potential = self._potentials()

    def run(self) -> tuple[int, ...]:
        moves: list[set[int]] = [set() for _ in range(self.slack + 1)]
        tight = [self._tight_options(robot) for robot in range(len(self.choice))]
        for robot, options in enumerate(tight):
            if len(options) > 1:
                moves[self.choice[robot]].add(robot)
        for robot, options in enumerate(tight):
            if len(options) == 1:
                continue
            start = self.choice[robot]
            moves[start].discard(robot)
            back = self._ways_back(start, moves, tight)
            target = next(option for option in options if option in back)
            self._rotate(robot, target, back, moves)
        return tuple(UNASSIGNED if d == self.idle else d for d in self.choice)

    def _tight_options(self, robot: int) -> list[int]:
        """Where the robot is in some optimum, as far as the potentials tell; in order."""
        here, options = self.choice[robot], self.options[robot]
        level = options[here] + self.potential[here]
        return sorted(d for d, p in options.items() if p + self.potential[d] == level)

    def _slack_moves(self) -> tuple[list[int], list[int]]:
        """(nodes that may give one up to the slack's gain, nodes that may take one from it)."""
        gives, takes = [self.idle] if self.counts[self.idle] else [], [self.idle]
        for demand, bounds in enumerate(self.problem.demands):
            if self.counts[demand] > bounds.lower:
                gives.append(demand)
            if self.counts[demand] < bounds.upper:
                takes.append(demand)
        return gives, takes

    def _potentials(self) -> list[int]:
        """Bellman-Ford over moves u -> v of cost p(i,u) - p(i,v); a negative cycle is a proof
        that the assignment was not optimal."""
        cost: dict[tuple[int, int], int] = {}
        for robot, here in enumerate(self.choice):
            options = self.options[robot]
            for there, value in options.items():
                if there != here:
                    change = options[here] - value
                    if change < cost.get((here, there), change + 1):
                        cost[here, there] = change
        gives, takes = self._slack_moves()
        cost.update({(self.slack, node): 0 for node in gives})
        cost.update({(node, self.slack): 0 for node in takes})
        distance = [0] * (self.slack + 1)
        for _ in range(self.slack + 2):
            changed = False
            for (source, target), change in cost.items():
                if distance[source] + change < distance[target]:
                    distance[target] = distance[source] + change
                    changed = True
            if not changed:
                # A move u -> v is tight when p(u) - p(v) + d(u) - d(v) = 0.
                return distance
        raise SolverError("the assignment is not optimal: moving robots around a cycle gains")

    def _ways_back(
        self, start: int, moves: list[set[int]], tight: list[list[int]]
    ) -> dict[int, tuple[int, int]]:
        """Nodes from which zero-cost moves of robots not yet fixed lead to `start`.

        Maps each node to (next node, robot that moves there, or -1 for the slack).
        """
        into: dict[int, list[tuple[int, int]]] = {}
        for node, robots in enumerate(moves):
            for robot in sorted(robots):
                for target in tight[robot]:
                    if target != node:
                        into.setdefault(target, []).append((node, robot))
        gives, takes = self._slack_moves()
        level = self.potential[self.slack]
        for node in gives:
            if self.potential[node] == level:
                into.setdefault(node, []).append((self.slack, -1))
        for node in takes:
            if self.potential[node] == level:
                into.setdefault(self.slack, []).append((node, -1))
        back: dict[int, tuple[int, int]] = {start: (start, -1)}
        queue = [start]
        for node in queue:
            for source, robot in into.get(node, ()):
                if source not in back:
                    back[source] = (node, robot)
                    queue.append(source)
        return back

    def _rotate(
        self, robot: int, target: int, back: dict[int, tuple[int, int]], moves: list[set[int]]
    ) -> None:
        start = self.choice[robot]
        if target == start:
            return
        self._move(robot, target)
        node = target
        while node != start:
            following, mover = back[node]
            if mover >= 0:
                moves[node].discard(mover)
                self._move(mover, following)
                moves[following].add(mover)
            node = following

    def _move(self, robot: int, target: int) -> None:
        self.counts[self.choice[robot]] -= 1
        self.counts[target] += 1
        self.choice[robot] = target
