"""CBAA, the single-assignment auction: the paper's algorithms 1 and 2.

Where the paper leaves ties open, of two equal bids that of the robot with the lower number is
higher; so the bidder's number goes along with each bid, as the paper suggests.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.cbba.outcome import NotConvergedError, Outcome, message_bytes, pick


def cbaa(values: NDArray[np.int64], links: NDArray[np.bool_], *, spread: bool = False) -> Outcome:
    """One task at most for each robot; `values`: robots x tasks, 0 where the robot cannot.

    Raises NotConvergedError after as many rounds as the paper allows, which is a mistake here.
    """
    robots, tasks = values.shape
    rank = robots - np.arange(robots)  # 1 .. robots, the lower number's is higher
    offers = np.where(values > 0, values * (robots + 1) + rank[:, None], 0)
    highest = np.zeros((robots, tasks), dtype=np.int64)  # each robot's list of winning bids
    holds = np.full(robots, -1)
    degree = links.sum(axis=1)
    hearing = links | np.eye(robots, dtype=np.bool_)
    messages = payload = 0
    _bid(values, offers, highest, holds, spread)
    for rounds in range(robots * robots + 1):
        if (highest == highest[0]).all():
            winners = tuple(int(robots - bid % (robots + 1)) if bid else -1 for bid in highest[0])
            paths = tuple((int(task),) if task >= 0 else () for task in holds)
            return Outcome(paths, winners, rounds, messages, payload)
        for robot in range(robots):
            bids, bidders = np.divmod(highest[robot], robots + 1)
            payload += int(degree[robot]) * message_bytes((bids, bidders))
        messages += int(degree.sum())
        highest = np.stack([highest[heard].max(axis=0) for heard in hearing])
        busy = np.flatnonzero(holds >= 0)
        lost = busy[highest[busy, holds[busy]] != offers[busy, holds[busy]]]
        holds[lost] = -1
        _bid(values, offers, highest, holds, spread)
    raise NotConvergedError(f"CBAA: {robots} robots, {tasks} tasks")


def _bid(
    values: NDArray[np.int64],
    offers: NDArray[np.int64],
    highest: NDArray[np.int64],
    holds: NDArray[np.int64],
    spread: bool,
) -> None:
    """Phase 1: whoever has no task bids for the best one that it would win."""
    for robot in np.flatnonzero(holds < 0):
        open_values = np.where(offers[robot] > highest[robot], values[robot], 0)
        if open_values.any():
            task = pick(open_values, int(robot), spread)
            holds[robot] = task
            highest[robot, task] = offers[robot, task]
