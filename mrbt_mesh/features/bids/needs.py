"""Needs whose performances robots bid (`performance: bid`), and names of what bids add."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission, Need

# Kinds of facts for one local task of an activation: the author's bid; no more bids are awaited.
BID, CLOSED = "bid", "closed"
# What plans and summaries have of the bids.
IN_PLAN = "bids"
# The longest that a mission may have plans wait for bids.
MAX_BID_WITHIN_US = 10_000_000


def bid_rule(within_us: int | None = None) -> tuple[Any, ...]:
    """The performance rule of a need for which robots bid, and plans wait this long; None: as long
    as usual.
    """
    return True, within_us


def is_bid_rule(rule: Sequence[Any]) -> bool:
    """True if plain data are such a rule."""
    if len(rule) != 2 or rule[0] is not True:
        return False
    within_us = rule[1]
    return within_us is None or (type(within_us) is int and 0 < within_us <= MAX_BID_WITHIN_US)


def by_bid(need: Need) -> bool:
    """True if robots bid for this local task."""
    return need.performance_rule[:1] == (True,)


def bid_within_us(need: Need) -> int | None:
    """How long plans wait for bids; None: as long as usual."""
    within_us: int | None = need.performance_rule[1]
    return within_us


def has_bids(mission: Mission) -> bool:
    """True if robots bid for any local task of the mission."""
    return any(by_bid(need) for task in mission.all_tasks() for need in task.needs)
