"""How regularly news of one robot arrives here, on whatever way: what its silence may mean.

Measured over time, not per beat, so that quick repeats do not dilute it. Integers only.
"""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.core.membership.timing import Timing

# Before anything was heard: one silent beat period in four.
PRIOR_PERIODS = 4
# Older experience counts for less: both sums are halved when they cover that many periods.
MEMORY_PERIODS = 128


@dataclass(slots=True)
class ArrivalHistory:
    """Sums over the gaps between pieces of news: `watched_us` in all, and of it `silent_us`
    beyond a beat period and a quarter, when news was overdue.
    """

    observed_us: int
    overdue_us: int

    @staticmethod
    def of_new_robot(timing: Timing) -> ArrivalHistory:
        """Of a robot that is new here."""
        return ArrivalHistory(PRIOR_PERIODS * timing.heartbeat_us, timing.heartbeat_us)

    def add_interval(self, gap_us: int, timing: Timing) -> None:
        """News came `gap_us` after the news before."""
        self.observed_us += gap_us
        overdue_us = gap_us - timing.heartbeat_us * 5 // 4
        if overdue_us > 0:
            self.overdue_us += overdue_us
        if self.observed_us > MEMORY_PERIODS * timing.heartbeat_us:
            self.observed_us //= 2
            self.overdue_us //= 2

    @property
    def overdue_permille(self) -> int:
        """In which share of the time news was overdue, rounded up."""
        return -(-1_000 * self.overdue_us // self.observed_us)
