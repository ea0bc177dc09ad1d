"""Random missions in which robots bid, and programs that bid badly."""

from __future__ import annotations

import random
from typing import Any

from mrbt_mesh.features.bids.file_fields import PERFORMANCE
from mrbt_mesh.sim.chaos.feature_chaos import FeatureChaos

# The share of missions in which robots bid.
SHARE = 0.25


class BidsChaos(FeatureChaos):
    """See `FeatureChaos`."""

    def __init__(self, seed: int) -> None:
        self._pick = random.Random(f"{seed}/bids")
        self._is_used = self._pick.random() < SHARE

    def add_to_need(self, need: dict[str, Any]) -> None:
        if self._is_used and self._pick.random() < 0.6:
            need[PERFORMANCE] = self._pick.choice(["bid", "bid", {"bid_within_s": 1.5}])

    def add_to_behaviour(self, behaviour: dict[str, Any]) -> None:
        if self._is_used and self._pick.random() < 0.5:
            kinds = ("no_permille", "fails_permille", "late_permille")
            behaviour["bid"] = {kind: self._pick.choice([0, 100, 300]) for kind in kinds}
