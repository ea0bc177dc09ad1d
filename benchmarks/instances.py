"""Random assignment problems as arrays, the same for all benchmarks.

Demands are offered in order, and those are kept that are feasible together with the ones kept
before: what *Check Consistency* does. The problem is that of the kept ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

CAPABLE = 10
LOWER = (1, 3)
UPPER = 5


class Density(StrEnum):
    """Sparse: CAPABLE robots per demand can serve it, drawn at random. Dense: all can."""

    SPARSE = "sparse"
    DENSE = "dense"


class Values(StrEnum):
    """What performances are drawn from, each number as likely as any other."""

    WIDE = "1..1000"
    NARROW = "1..10"
    EQUAL = "all 1"

    @property
    def highest(self) -> int:
        """The highest performance there is."""
        return {Values.WIDE: 1000, Values.NARROW: 10, Values.EQUAL: 1}[self]


@dataclass(frozen=True)
class Spec:
    """What to draw. The same spec gives the same instance."""

    robots: int
    offered: int
    density: Density
    values: Values
    seed: int


@dataclass(frozen=True)
class Instance:
    """Demand j takes between lower[j] and upper[j] robots.

    Robot robot[k] can serve demand demand[k] with performance[k] > 0; these pairs are sorted by
    robot, then by demand. All arrays are int64. The lower bounds can be met together.
    """

    robots: int
    lower: NDArray[np.int64]
    upper: NDArray[np.int64]
    robot: NDArray[np.int64]
    demand: NDArray[np.int64]
    performance: NDArray[np.int64]

    @property
    def demands(self) -> int:
        """How many demands there are."""
        return len(self.lower)

    @property
    def pairs(self) -> int:
        """How many (robot, demand) pairs are capable."""
        return len(self.robot)

    def matrix(self) -> NDArray[np.int64]:
        """Performances as robots x demands, 0 where the robot cannot."""
        found = np.zeros((self.robots, self.demands), dtype=np.int64)
        found[self.robot, self.demand] = self.performance
        return found

    def slots(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Each demand once per robot that it may take, and whether its lower bound needs that."""
        demand = np.repeat(np.arange(self.demands), self.upper)
        first = np.repeat(np.cumsum(self.upper) - self.upper, self.upper)
        return demand, np.arange(len(demand)) - first < self.lower[demand]

    def objective(self, choice: NDArray[np.int64]) -> int:
        """The sum of performances of an assignment: a demand, or -1, per robot.

        Raises ValueError if a bound is broken or a robot cannot serve what it was given.
        """
        counts = np.bincount(choice[choice >= 0], minlength=self.demands)
        if len(choice) != self.robots or len(counts) != self.demands:
            raise ValueError("the answer does not fit the problem")
        if np.any(counts < self.lower) or np.any(counts > self.upper):
            raise ValueError("the answer breaks a bound")
        taken = choice[self.robot] == self.demand
        if np.count_nonzero(taken) != np.count_nonzero(choice >= 0):
            raise ValueError("the answer puts a robot where it cannot work")
        return int(self.performance[taken].sum())


def draw(spec: Spec) -> Instance:
    """The instance of a spec."""
    random = np.random.default_rng(
        [spec.seed, spec.robots, spec.offered, spec.density is Density.DENSE, spec.values.highest]
    )
    lower = random.integers(LOWER[0], LOWER[1] + 1, spec.offered)
    upper = random.integers(lower, UPPER + 1)
    if spec.density is Density.DENSE:
        kept = keep_dense(spec.robots, lower)
        robot, demand = np.divmod(np.arange(spec.robots * len(kept)), max(1, len(kept)))
    else:
        width = min(CAPABLE, spec.robots)
        capable = [
            np.sort(random.choice(spec.robots, width, replace=False)) for _ in range(spec.offered)
        ]
        kept = keep_sparse(spec.robots, lower, capable)
        robot = np.concatenate([capable[j] for j in kept]) if kept else np.empty(0, np.int64)
        demand = np.repeat(np.arange(len(kept)), width)
        order = np.lexsort((demand, robot))
        robot, demand = robot[order], demand[order]
    performance = random.integers(1, spec.values.highest + 1, len(robot))
    return Instance(spec.robots, lower[kept], upper[kept], robot, demand, performance)


def keep_dense(robots: int, lower: NDArray[np.int64]) -> list[int]:
    """The demands that are kept where every robot can serve each."""
    kept, left = [], robots
    for index, needed in enumerate(lower.tolist()):
        if needed <= left:
            kept.append(index)
            left -= needed
    return kept


def keep_sparse(
    robots: int, lower: NDArray[np.int64], capable: Sequence[NDArray[np.int64]]
) -> list[int]:
    """The demands that are kept: slots filled along augmenting paths, a demand's all or none."""
    matched: list[int] = [-1] * robots  # the demand that a robot is kept for
    candidates = [robots_of.tolist() for robots_of in capable]
    dead: set[int] = set()  # robots from which no path leads to a free one, ever again
    kept = []
    for index, needed in enumerate(lower.tolist()):
        if sum(robot not in dead for robot in candidates[index]) < needed:
            continue
        before: list[tuple[int, int]] = []
        for number in range(needed):
            changes, seen = _augment(index, matched, candidates, dead)
            if not changes:
                if number == 0:  # else slots are emptied again, and the paths may open again
                    dead |= seen
                break
            before += [(robot, matched[robot]) for robot, _ in changes]
            for robot, demand in changes:
                matched[robot] = demand
        else:
            kept.append(index)
            continue
        for robot, demand in reversed(before):
            matched[robot] = demand
    return kept


def _augment(
    demand: int, matched: list[int], candidates: list[list[int]], dead: set[int]
) -> tuple[list[tuple[int, int]], set[int]]:
    """(robot, its new demand) along an augmenting path; the robots that were seen."""
    wanted_by: dict[int, int] = {}
    entered_by: dict[int, int] = {demand: -1}  # the robot that led to the demand it is matched to
    queue = [demand]
    for seeker in queue:
        for robot in candidates[seeker]:
            if robot in wanted_by or robot in dead:
                continue
            wanted_by[robot] = seeker
            holder = matched[robot]
            if holder < 0:
                changes = []
                while robot >= 0:
                    changes.append((robot, wanted_by[robot]))
                    robot = entered_by[wanted_by[robot]]
                return changes, set()
            if holder not in entered_by:
                entered_by[holder] = robot
                queue.append(holder)
    return [], set(wanted_by)
