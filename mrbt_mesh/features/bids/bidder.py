"""Bids of this robot's program, for missions with local tasks that are assigned by bid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mrbt_mesh.core.agent.inputs import FeatureInput
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.feature import Kit, Part
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.features.bids.facts import Bid
from mrbt_mesh.features.bids.messages import BidMade, BidsMade, RequestBid
from mrbt_mesh.features.bids.needs import BID
from mrbt_mesh.features.bids.plan import biddings


class Bidder(Part):
    """Asks the program for bids, and writes them as facts."""

    def __init__(self, kit: Kit) -> None:
        self._context = kit.context
        self._health = kit.health
        # The (activation, local task) pairs for which the program was asked for a bid.
        self._asked: set[tuple[str, str]] = set()
        self._failed: set[str] = set()

    def handlers(self) -> Mapping[type[FeatureInput], Callable[[Any, int], object]]:
        return {BidsMade: self._made}

    def prepare(self, plan: Plan, now_us: int) -> None:
        """Ask this robot's program once for each bid that the plan lacks."""
        context = self._context
        wanted = {
            (bidding.activation, bidding.local_task): bidding.global_task
            for bidding in biddings(plan)
            if context.me in bidding.silent
        }
        fresh = sorted(wanted.keys() - self._asked)
        self._asked = set(wanted)
        incarnation = context.replica.incarnation
        for activation, local_task in fresh:
            value = context.description.performance(local_task)
            if value is not None:
                task = wanted[activation, local_task]
                context.emit(RequestBid(activation, task, local_task, value, incarnation))

    def _made(self, event: BidsMade, now_us: int) -> None:
        """Write bids in one batch. Bids that arrive while the robot joins are requested again."""
        context = self._context
        if context.joining is not None:
            self._asked.clear()
            return
        writes: dict[str, Bid] = {}
        problems: dict[str, str] = {}
        for bid in event.bids:
            record, error = _checked(bid)
            if error:
                subject = f"bid for {type_name(bid.local_task)}"
                if subject not in self._failed:
                    self._failed.add(subject)
                    context.log("error", "bid_failed", local_task=bid.local_task, error=error)
                problems[subject] = f"made no bid: {bid.reason or error}"
            if (bid.activation, bid.local_task) in self._asked:
                # Other bids are no longer needed.
                writes[f"{BID}/{bid.activation}/{bid.local_task}"] = record
        facts: list[Fact] = [(name, writes[name]) for name in sorted(writes)]
        facts += self._health.problem_facts(problems)
        if facts:
            context.write(facts, now_us)


def _checked(bid: BidMade) -> tuple[Bid, str]:
    """Return a bid's record and an error text. A failed program's bid has no performance."""
    try:
        return Bid.parse(None if bid.error else bid.performance), bid.error
    except ValueError as error:
        return Bid(None), str(error)
