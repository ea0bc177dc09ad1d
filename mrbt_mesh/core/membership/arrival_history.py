"""How regularly news of one robot arrives here, by whatever way: what its silence may mean.

After the phi accrual failure detector (Hayashibara, Defago, Yared, Katayama 2004), which also
derives a timeout from measured arrivals. Here the measure is the share of time in which news was
overdue: it needs no distribution, and repeats that follow one another quickly do not dilute it.
Integers only.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.core.membership.timing import Timing

# Of a robot that was never heard before: one heartbeat in four is lost.
PRIOR_PERIODS = 4
# Older experience counts for less: both sums are halved when they cover that many periods.
MEMORY_PERIODS = 128


@dataclass(slots=True)
class ArrivalHistory:
    """Sums over the intervals between pieces of news.

    `observed_us`: all of them. `overdue_us`: what each was longer than 5/4 of a heartbeat period.
    """

    observed_us: int
    overdue_us: int

    @staticmethod
    def of_new_robot(timing: Timing) -> ArrivalHistory:
        """Of a robot that was never heard before."""
        return ArrivalHistory(PRIOR_PERIODS * timing.heartbeat_us, timing.heartbeat_us)

    def add_interval(self, interval_us: int, timing: Timing) -> None:
        """News came `interval_us` after the news before."""
        self.observed_us += interval_us
        overdue_us = interval_us - timing.overdue_us
        if overdue_us > 0:
            self.overdue_us += overdue_us
        if self.observed_us > MEMORY_PERIODS * timing.heartbeat_us:
            self.observed_us //= 2
            self.overdue_us //= 2

    @property
    def overdue_permille(self) -> int:
        """In which share of the time news was overdue, rounded up."""
        return -(-1_000 * self.overdue_us // self.observed_us)
