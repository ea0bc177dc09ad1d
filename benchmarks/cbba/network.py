"""Who can talk to whom: symmetric boolean matrices without a diagonal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def complete(robots: int) -> NDArray[np.bool_]:
    """Everybody to everybody."""
    return ~np.eye(robots, dtype=np.bool_)


def line(robots: int) -> NDArray[np.bool_]:
    """Each to the next."""
    return np.eye(robots, k=1, dtype=np.bool_) | np.eye(robots, k=-1, dtype=np.bool_)


def ring(robots: int) -> NDArray[np.bool_]:
    """A line whose ends are joined."""
    links = line(robots)
    if robots > 2:
        links[0, -1] = links[-1, 0] = True
    return links


def random(robots: int, seed: int) -> NDArray[np.bool_]:
    """A random tree and as many further links again, so that it is connected."""
    draw = np.random.default_rng([seed, robots])
    links = np.zeros((robots, robots), dtype=np.bool_)
    for robot in range(1, robots):
        other = int(draw.integers(robot))
        links[robot, other] = links[other, robot] = True
    for robot, other in draw.integers(robots, size=(robots, 2)).tolist():
        if robot != other:
            links[robot, other] = links[other, robot] = True
    return links


def distances(links: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Hops between robots; raises ValueError if some cannot be reached."""
    robots = len(links)
    found = np.where(np.eye(robots, dtype=np.bool_), 0, -1)
    reached = np.eye(robots, dtype=np.bool_)
    for hops in range(1, robots):
        further = (reached @ links) & ~reached
        if not further.any():
            break
        found[further] = hops
        reached |= further
    if not reached.all():
        raise ValueError("the network is not connected")
    return found


def flooding(links: NDArray[np.bool_], record_bytes: NDArray[np.int64]) -> tuple[int, int, int]:
    """(rounds, messages, bytes) until everybody has one record of everybody.

    In each round a robot sends its neighbours what it has learned in the round before.
    """
    hops = distances(links)
    rounds = int(hops.max())
    degree = links.sum(axis=1)
    forwarded = np.where(hops < rounds, record_bytes[None, :], 0).sum(axis=1)
    return rounds, int(degree.sum()) * rounds, int((forwarded * degree).sum())
