"""The facts of bids, and their index."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from mrbt_mesh.core.facts.records import Plain, Record
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.values import read_integer
from mrbt_mesh.core.feature import Index
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE


def _read_bid(value: Any) -> int | None:
    return None if value is None else read_integer(value, -MAX_PERFORMANCE, MAX_PERFORMANCE)


@dataclass(frozen=True, slots=True)
class Bid(Record):
    """The performance that the author would have, in micro-units; None: it makes no bid.

    The first bid counts, so a restarted robot does not outbid itself.
    """

    performance: Annotated[int | None, Plain(_read_bid)]

    write_once: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class KnownBids:
    """The bids of one activation.

    `by_task`: local task -> robot -> bid in micro-units, None if the robot makes no bid. `closed`:
    local tasks for which no more bids are awaited.
    """

    by_task: Mapping[str, Mapping[str, int | None]] = field(default_factory=dict)
    closed: frozenset[str] = frozenset()

    def of(self, local_task: str) -> Mapping[str, int | None]:
        """Robot -> its bid for this local task."""
        return self.by_task.get(local_task, {})

    def with_bid(self, local_task: str, robot: str, bid: int | None) -> KnownBids:
        """Return these bids with one more."""
        bids = {**self.of(local_task), robot: bid}
        return KnownBids({**self.by_task, local_task: bids}, self.closed)

    def with_closed(self, local_task: str) -> KnownBids:
        """Return these bids, with no more awaited for this local task."""
        return KnownBids(self.by_task, self.closed | {local_task})


NO_BIDS = KnownBids()


class BidIndex(Index):
    """The bids of all activations."""

    def __init__(self) -> None:
        self._by_activation: dict[str, KnownBids] = {}

    def of(self, activation: str) -> KnownBids:
        """The bids of an activation."""
        return self._by_activation.get(activation, NO_BIDS)

    def add(self, entry: Entry) -> None:
        _, activation, local_task = entry.parts
        known, record = self.of(activation), entry.record
        if isinstance(record, Bid):
            known = known.with_bid(local_task, entry.author, record.performance)
        else:
            known = known.with_closed(local_task)
        self._by_activation[activation] = known

    def remove(self, entry: Entry) -> None:
        # All entries of an activation are dropped together.
        self._by_activation.pop(entry.parts[1], None)


def bids_of(facts: TeamFacts, activation: str) -> KnownBids:
    """The bids of an activation, in a mission in which robots bid."""
    return facts.index(BidIndex).of(activation)
