"""Random missions with conditions that every robot has for itself."""

from __future__ import annotations

import random
from typing import Any

from mrbt_mesh.sim.chaos.feature_chaos import FeatureChaos

# The share of missions that have such conditions.
SHARE = 0.25


class OwnChaos(FeatureChaos):
    """See `FeatureChaos`."""

    def __init__(self, seed: int) -> None:
        self._pick = random.Random(f"{seed}/owned")
        self._is_used = self._pick.random() < SHARE

    def add_to_condition(self, declared: dict[str, Any]) -> None:
        if self._is_used and self._pick.random() < 0.6:
            declared |= {"default": False, "per": "robot"}
