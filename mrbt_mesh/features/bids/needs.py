"""Needs whose performances robots bid (`performance: bid`), and names of what bids add."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mrbt_mesh.core.feature import PerformanceRule

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission, Need

# Kinds of facts for one local task of an activation: the author's bid; no more bids are awaited.
BID, CLOSED = "bid", "closed"
# What plans and summaries have of the bids.
IN_PLAN = "bids"
# The longest that a mission may have plans wait for bids.
MAX_BID_WITHIN_US = 10_000_000


@dataclass(frozen=True, slots=True)
class BidRule(PerformanceRule):
    """Robots bid, and plans wait this long for bids; None: as long as usual."""

    within_us: int | None = None

    def problem(self) -> str:
        is_right = self.within_us is None or 0 < self.within_us <= MAX_BID_WITHIN_US
        return "" if is_right else f"bids within {self.within_us} us"


def by_bid(need: Need) -> bool:
    """True if robots bid for this local task."""
    return isinstance(need.performance_rule, BidRule)


def bid_within_us(need: Need) -> int | None:
    """How long plans wait for bids; None: as long as usual."""
    rule = need.performance_rule
    return rule.within_us if isinstance(rule, BidRule) else None


def has_bids(mission: Mission) -> bool:
    """True if robots bid for any local task of the mission."""
    return any(by_bid(need) for task in mission.all_tasks() for need in task.needs)
