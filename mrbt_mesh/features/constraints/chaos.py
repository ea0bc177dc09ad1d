"""Random missions with side constraints."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Any

from mrbt_mesh.features.constraints.kinds import SECTION
from mrbt_mesh.sim.chaos.feature_chaos import FeatureChaos

# The share of missions that get side constraints.
SHARE = 0.08


class ConstraintsChaos(FeatureChaos):
    """See `FeatureChaos`."""

    def __init__(self, seed: int) -> None:
        self._pick = random.Random(f"{seed}/constraints")
        self._is_used = self._pick.random() < SHARE

    def add(
        self, mission: dict[str, Any], robots: Sequence[str], types: Mapping[str, Mapping[str, Any]]
    ) -> None:
        if not self._is_used or len(robots) < 2:
            return
        pick = self._pick
        found: dict[str, Any] = {}
        while not found:
            if pick.random() < 0.5:
                who = sorted(pick.sample(robots, pick.randint(2, len(robots))))
                found["at_most"] = [{"robots": who, "count": pick.randint(1, len(who) - 1)}]
            if pick.random() < 0.5:
                pair = sorted(pick.sample(robots, 2))
                found["never_together"] = [{"robots": pair}]
            names = sorted(mission["global_tasks"])
            if pick.random() < 0.5 and len(names) > 1:
                some = sorted(pick.sample(names, 2))
                found["not_at_once"] = [{"global_tasks": some}]
        mission[SECTION] = found
