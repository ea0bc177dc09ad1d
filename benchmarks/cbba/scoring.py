"""What tasks are worth to a robot, given the path it already has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Scoring(Protocol):
    """The marginal gains of a problem; they must not grow with the path (DMG)."""

    robots: int
    tasks: int
    bundle_size: int

    def gains(self, robot: int, path: Sequence[int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Per task (gain, best place in the path); a gain of 0: not to be bid for."""
        ...


class SingleTask:
    """One task per robot: a bundle of size 1, worth what the matrix says."""

    bundle_size = 1

    def __init__(self, values: NDArray[np.int64]) -> None:
        """`values`: robots x tasks, 0 where the robot cannot."""
        self.values = values
        self.robots, self.tasks = values.shape
        self._start = np.zeros(self.tasks, dtype=np.int64)

    def gains(self, robot: int, path: Sequence[int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """As Scoring.gains, for an empty path: a robot with a task has no room left."""
        assert not path
        return self.values[robot], self._start


class DiscountedTours:
    """Time-discounted rewards along a tour through the plane: the paper's equation (11).

    A task is worth reward * discount^(way to it along the path), in millionths, rounded.
    """

    def __init__(
        self,
        robots: NDArray[np.float64],
        tasks: NDArray[np.float64],
        rewards: Sequence[float],
        discount: float,
        bundle_size: int,
    ) -> None:
        """`robots` and `tasks`: positions, one row each."""
        self.robots, self.tasks, self.bundle_size = len(robots), len(tasks), bundle_size
        self._robots, self._places = robots, tasks
        self._rewards, self._discount = rewards, discount

    def score(self, robot: int, path: Sequence[int]) -> int:
        """What a path is worth."""
        here, way, worth = self._robots[robot], 0.0, 0
        for task in path:
            way += float(np.linalg.norm(self._places[task] - here))
            here = self._places[task]
            worth += round(1e6 * self._rewards[task] * self._discount**way)
        return worth

    def gains(self, robot: int, path: Sequence[int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """As Scoring.gains."""
        found = np.zeros(self.tasks, dtype=np.int64)
        places = np.zeros(self.tasks, dtype=np.int64)
        have = self.score(robot, path)
        for task in range(self.tasks):
            if task in path:
                continue
            options = [
                self.score(robot, [*path[:place], task, *path[place:]]) - have
                for place in range(len(path) + 1)
            ]
            places[task] = int(np.argmax(options))
            found[task] = max(0, max(options))
        return found, places
