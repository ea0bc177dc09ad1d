"""Revisions: another mission in the place of the one that a team runs (`mrbt revise`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mrbt_mesh.core.feature import Feature, Kit, Part

if TYPE_CHECKING:
    from mrbt_mesh.features.revisions.checker import Revised
    from mrbt_mesh.sim.checkers.findings import RunFindings


class RevisedMissions(Feature):
    """The feature. Any team may get a revision, so no mission declares it."""

    def parts(self, kit: Kit, before: Sequence[Part], now_us: int) -> Sequence[Part]:
        from mrbt_mesh.features.revisions.reviser import Reviser

        return before or (Reviser(kit),)

    def checkers(self, run: RunFindings) -> Sequence[Revised]:
        from mrbt_mesh.features.revisions.checker import Revised

        return (Revised(run),)


FEATURE = RevisedMissions()
