"""Robots bid for local tasks whose performance only they know (`performance: bid`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.feature import Feature, Kit, Part
from mrbt_mesh.features.bids.needs import (
    BID,
    CLOSED,
    IN_PLAN,
    BidRule,
    by_bid,
    has_bids,
)

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from mrbt_mesh.core.facts.records import Record
    from mrbt_mesh.core.facts.store import Entry
    from mrbt_mesh.core.mission.mission import GlobalTask, Mission
    from mrbt_mesh.features.bids.chaos import BidsChaos
    from mrbt_mesh.features.bids.checker import BidsFirst
    from mrbt_mesh.features.bids.facts import BidIndex
    from mrbt_mesh.features.bids.history import BidHistory
    from mrbt_mesh.features.bids.plan import BidStep
    from mrbt_mesh.formats.mission_model import NeedModel
    from mrbt_mesh.formats.problems import Report, SourcePath
    from mrbt_mesh.sim.checkers.findings import RunFindings


class Bids(Feature):
    """The feature."""

    kinds = {BID: 3, CLOSED: 3}  # noqa: RUF012
    in_plan = IN_PLAN

    def mission_classes(self) -> Sequence[type]:
        return (BidRule,)

    def file_fields(self) -> Mapping[str, Mapping[str, tuple[Any, FieldInfo]]]:
        from mrbt_mesh.features.bids.file_fields import FIELDS

        return FIELDS

    def performance_rule(
        self, need: NeedModel, local_task: str, path: SourcePath, report: Report
    ) -> BidRule | None:
        from mrbt_mesh.features.bids.file import performance_rule

        return performance_rule(need, local_task, path, report)

    def parse(self, kind: str, value: Any) -> Record:
        from mrbt_mesh.core.facts.records import Latch
        from mrbt_mesh.features.bids.facts import Bid

        return Bid.parse(value) if kind == BID else Latch.parse(value)

    def refuses(self, entry: Entry, task: GlobalTask) -> str:
        local_task = entry.parts[2]
        need = task.need(local_task)
        if need is None or not by_bid(need):
            return f"{task.id!r}: {local_task!r:.80} is not for bids"
        return ""

    def index(self, mission: Mission) -> BidIndex | None:
        if not has_bids(mission):
            return None
        from mrbt_mesh.features.bids.facts import BidIndex

        return BidIndex()

    def plan_step(self, mission: Mission) -> BidStep | None:
        if not has_bids(mission):
            return None
        from mrbt_mesh.features.bids.plan import BidStep

        return BidStep()

    def parts(self, kit: Kit, before: Sequence[Part], now_us: int) -> Sequence[Part]:
        # A bidder stays, as its program may yet answer.
        if before or not has_bids(kit.context.mission):
            return before
        from mrbt_mesh.features.bids.bidder import Bidder

        return (Bidder(kit),)

    def history(self, limit: int | None) -> BidHistory:
        from mrbt_mesh.features.bids.history import BidHistory

        return BidHistory(limit)

    def chaos(self, seed: int) -> BidsChaos:
        from mrbt_mesh.features.bids.chaos import BidsChaos

        return BidsChaos(seed)

    def checkers(self, run: RunFindings) -> Sequence[BidsFirst]:
        from mrbt_mesh.features.bids.checker import BidsFirst

        return (BidsFirst(run),)


FEATURE = Bids()
