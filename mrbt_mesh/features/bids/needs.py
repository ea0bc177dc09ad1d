"""Needs whose performances robots bid (`performance: bid`), and names of what bids add."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission, Need

# Kinds of facts for one local task of an activation: the author's bid; no more bids are awaited.
BID, CLOSED = "bid", "closed"
# What plans and summaries have of the bids.
IN_PLAN = "bids"


def by_bid(need: Need) -> bool:
    """True if robots bid for this local task."""
    return need.by_bid


def bid_within_us(need: Need) -> int | None:
    """How long plans wait for bids; None: as long as usual."""
    return need.bid_within_us


def has_bids(mission: Mission) -> bool:
    """True if robots bid for any local task of the mission."""
    return any(by_bid(need) for task in mission.all_tasks() for need in task.needs)
