"""Demands with bounds as single tasks, for auctions that know no bounds.

A demand that takes up to mu robots becomes mu tasks, all worth its performance. That keeps the
upper bound. An auction has no notion of a lower bound, so the first nu of them get a bonus that is
higher than any performance: any robot then prefers a task that a lower bound needs to all
others, and takes it from nobody but a better robot for the same. A greater bonus would change
nothing, as only the order of bids counts. That is the most one can do without changing the
auction; it still leaves lower bounds unmet, because a robot takes the best needed task for itself
and not the one that only it could do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.cbba.outcome import Outcome
from benchmarks.instances import Instance


@dataclass(frozen=True)
class Slots:
    """`values`: robots x slots, 0 where the robot cannot; `demand`: of each slot."""

    values: NDArray[np.int64]
    demand: NDArray[np.int64]

    def choice(self, outcome: Outcome) -> NDArray[np.int64]:
        """The demand of each robot, or -1."""
        return np.array([self.demand[path[0]] if path else -1 for path in outcome.paths])


def slots(instance: Instance, bonus: bool) -> Slots:
    """The single tasks of an instance."""
    demand = np.repeat(np.arange(instance.demands), instance.upper)
    first = np.repeat(np.cumsum(instance.upper) - instance.upper, instance.upper)
    needed = np.arange(len(demand)) - first < instance.lower[demand]
    values = instance.matrix()[:, demand]
    if bonus:
        worth = int(instance.performance.max(initial=0)) + 1
        values = np.where((values > 0) & needed, values + worth, values)
    return Slots(values, demand)


@dataclass(frozen=True)
class Verdict:
    """`score`: the sum of performances. `usable`: of those on demands whose lower bound is met,
    for the others cannot begin. `missed`: demands whose lower bound is not met."""

    score: int
    usable: int
    missed: int


def judge(instance: Instance, choice: NDArray[np.int64]) -> Verdict:
    """What an assignment that may break lower bounds is worth; raises ValueError if it breaks
    an upper bound or a capability."""
    counts = np.bincount(choice[choice >= 0], minlength=instance.demands)
    met = counts >= instance.lower
    taken = choice[instance.robot] == instance.demand
    if np.any(counts > instance.upper) or taken.sum() != (choice >= 0).sum():
        raise ValueError("the answer breaks an upper bound or a capability")
    values = instance.performance[taken]
    usable = values[met[instance.demand[taken]]]
    return Verdict(int(values.sum()), int(usable.sum()), int(np.count_nonzero(~met)))
