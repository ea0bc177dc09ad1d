"""The bids of a run, for its timeline and its summary."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.features.bids.facts import Bid
from mrbt_mesh.features.bids.needs import IN_PLAN
from mrbt_mesh.observer.feature_history import FeatureHistory
from mrbt_mesh.observer.newest import Newest


@dataclass(slots=True)
class BiddingRecord:
    """The bids for a local task of one activation, in units, and the robots that ran it.

    None: the robot has no bid.
    """

    activation: str
    global_task: str
    local_task: str
    at_us: int
    bids: dict[str, float | None] = field(default_factory=dict)
    robots: set[str] = field(default_factory=set)


class BidHistory(FeatureHistory):
    """See `FeatureHistory`. `limit`: how many rows are kept."""

    name = IN_PLAN

    def __init__(self, limit: int | None) -> None:
        self.rows = Newest[BiddingRecord](limit)
        # Those that are kept, by activation and local task.
        self._kept: dict[tuple[str, str], BiddingRecord] = {}

    def fact(self, entry: Entry, now_us: int) -> str:
        """See `FeatureHistory`."""
        robot, record = entry.author, entry.record
        if not isinstance(record, Bid):
            return ""
        number = record.performance
        _, activation, local_task = entry.parts
        bidding = self._kept.get((activation, local_task))
        if bidding is None:
            task = parse_activation(activation).subject
            bidding = BiddingRecord(activation, task, local_task, now_us)
            self._kept[activation, local_task] = bidding
            for old in self.rows.append(bidding):
                del self._kept[old.activation, old.local_task]
        bidding.bids[robot] = None if number is None else number / MICRO
        words = "has no bid" if number is None else f"bids {number / MICRO:g}"
        return f"{robot}: {words} for {local_task}"

    def begun(self, robot: str, claim: Claim) -> None:
        """See `FeatureHistory`."""
        bidding = self._kept.get((claim.activation, claim.local_task))
        if bidding is not None:
            bidding.robots.add(robot)

    def to_json(self, seconds: Callable[[int], float | None]) -> list[dict[str, Any]]:
        """See `FeatureHistory`."""
        return [
            {
                "global_task": bidding.global_task,
                "local_task": bidding.local_task,
                "at_s": seconds(bidding.at_us),
                "bids": dict(sorted(bidding.bids.items())),
                "robots": sorted(bidding.robots),
            }
            for bidding in self.rows
        ]
