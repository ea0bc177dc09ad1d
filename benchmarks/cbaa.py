"""CBAA, the decentralised auction that the planner is compared with, and demands as its tasks.

Source: H.-L. Choi, L. Brunet, J. P. How, "Consensus-Based Decentralized Auctions for Robust Task
Allocation", IEEE Transactions on Robotics 25(4), 2009. Rounds are synchronous: every robot sends
its lists to all neighbours, then takes in what it has received. CBBA, the auction of bundles, is
the same where a robot does one task at a time.

A demand that takes up to mu robots becomes mu tasks, all worth its performance. That keeps the
upper bound. An auction has no notion of a lower bound, so the first nu of them get a bonus that is
higher than any performance: any robot then prefers a task that a lower bound needs to all
others, and takes it from nobody but a better robot for the same. A greater bonus would change
nothing, as only the order of bids counts. That is the most one can do without changing the
auction; it still leaves lower bounds unmet, because a robot takes the best needed task for itself
and not the one that only it could do.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import msgpack
import numpy as np
from numpy.typing import NDArray

from benchmarks.instances import Instance


@dataclass(frozen=True)
class Outcome:
    """`taken`: a task or -1 per robot; `winners`: a robot or -1 per task.

    `rounds` counts those until all robots hold the same lists and nobody bids any more, as an
    onlooker sees it; the robots themselves would need some more to know.
    """

    taken: tuple[int, ...]
    winners: tuple[int, ...]
    rounds: int
    messages: int
    bytes: int


class NotConvergedError(RuntimeError):
    """An auction did not come to an end."""


def message_bytes(lists: Iterable[NDArray[np.int64]]) -> int:
    """Length of a message with these lists in msgpack, the encoding that this project uses."""
    return len(msgpack.packb([each.tolist() for each in lists]))


def pick(gains: NDArray[np.int64], robot: int, spread: bool) -> int:
    """The task with the highest gain.

    Of equal ones the first, or with `spread` the robot's number picks one: robots that see the
    same ties then bid for different tasks, which saves rounds.
    """
    if not spread:
        return int(np.argmax(gains))
    equal = np.flatnonzero(gains == gains.max())
    return int(equal[robot % len(equal)])


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
            taken = tuple(map(int, holds))
            return Outcome(taken, winners, rounds, messages, payload)
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
    """Phase 1: each robot without a task bids for the best one that it would win."""
    for robot in np.flatnonzero(holds < 0):
        open_values = np.where(offers[robot] > highest[robot], values[robot], 0)
        if open_values.any():
            task = pick(open_values, int(robot), spread)
            holds[robot] = task
            highest[robot, task] = offers[robot, task]


# -- demands as tasks -------------------------------------------------------------------------


@dataclass(frozen=True)
class Slots:
    """`values`: robots x slots, 0 where the robot cannot; `demand`: of each slot."""

    values: NDArray[np.int64]
    demand: NDArray[np.int64]

    def choice(self, outcome: Outcome) -> NDArray[np.int64]:
        """The demand of each robot, or -1."""
        return np.array([self.demand[task] if task >= 0 else -1 for task in outcome.taken])


def slots(instance: Instance, bonus: bool) -> Slots:
    """The single tasks of an instance."""
    demand, needed = instance.slots()
    values = instance.matrix()[:, demand]
    if bonus:
        worth = int(instance.performance.max(initial=0)) + 1
        values = np.where((values > 0) & needed, values + worth, values)
    return Slots(values, demand)


@dataclass(frozen=True)
class Scores:
    """`score`: the sum of performances. `usable`: of those on demands whose lower bound is met,
    for the others cannot begin. `missed`: demands whose lower bound is not met."""

    score: int
    usable: int
    missed: int


def judge(instance: Instance, choice: NDArray[np.int64]) -> Scores:
    """The scores of an assignment, which may break lower bounds.

    Raises ValueError if it breaks an upper bound or a capability.
    """
    counts = np.bincount(choice[choice >= 0], minlength=instance.demands)
    met = counts >= instance.lower
    taken = choice[instance.robot] == instance.demand
    if np.any(counts > instance.upper) or taken.sum() != (choice >= 0).sum():
        raise ValueError("the answer breaks an upper bound or a capability")
    values = instance.performance[taken]
    usable = values[met[instance.demand[taken]]]
    return Scores(int(values.sum()), int(usable.sum()), int(np.count_nonzero(~met)))


# -- networks: symmetric boolean matrices without a diagonal ----------------------------------


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
