"""Build what a need of a mission file says of bids."""

from __future__ import annotations

from mrbt_mesh.core.mission.names import entries_in
from mrbt_mesh.features.bids.file_fields import PERFORMANCE, BidModel
from mrbt_mesh.features.bids.needs import BidRule
from mrbt_mesh.formats.expand import micro_or_report
from mrbt_mesh.formats.mission_model import NeedModel
from mrbt_mesh.formats.problems import Report, SourcePath


def performance_rule(
    need: NeedModel, local_task: str, path: SourcePath, report: Report
) -> BidRule | None:
    """Return the rule of a need, None if performances are declared; problems go to the report."""
    given: str | BidModel = getattr(need, PERFORMANCE)
    if given == "declared":
        return None
    within_us = None
    if isinstance(given, BidModel):
        place = (*path, PERFORMANCE, "bid_within_s")
        within_us = micro_or_report(given.bid_within_s, place, report)
    if entries_in(local_task):
        message = "a bid is made before anything is read from the blackboard"
        report.add(path, f"{message}; declare the performance")
    return BidRule(within_us)
