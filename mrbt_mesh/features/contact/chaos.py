"""Random missions with policies for lost contact, and partitions that take contact away."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Any

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.contact.policy import MAX_MAJORITY, SECTION, policies
from mrbt_mesh.sim.chaos.feature_chaos import FeatureChaos
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.scenario import Step

# The share of missions in which robots have a policy for lost contact.
SHARE = 0.12


class ContactChaos(FeatureChaos):
    """See `FeatureChaos`."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._pick = random.Random(f"{seed}/contact")
        self.likes_places = self._is_used = self._pick.random() < SHARE

    def add(
        self, mission: dict[str, Any], robots: Sequence[str], types: Mapping[str, Mapping[str, Any]]
    ) -> None:
        if not self._is_used:
            return
        pick, of = self._pick, ["team"]
        if len(robots) <= MAX_MAJORITY:
            of += ["majority", "majority"]
        for kind, given in sorted(mission["robot_types"].items()):
            if pick.random() < 0.2:
                continue
            lost = {"after_s": pick.choice([1, 1, 2, 4]), "of": pick.choice(of)}
            lost["then"] = pick.choice(["go_on", "finish", "hold", "hold", "hold", "return"])
            if lost["then"] == "return":
                lost["return"] = pick.choice(sorted(types[kind]))
            given[SECTION] = lost

    def steps(self, mission: Mission, robots: Sequence[str], chaos_us: int) -> list[Step]:
        """Cut a minority of the robots off from all others for some seconds."""
        if not policies(mission) or len(robots) < 3:
            return []
        pick = random.Random(f"{self._seed}/contact")
        away = set(pick.sample(robots, pick.randint(1, (len(robots) - 1) // 2)))
        block = faults.partition(away, set(robots) - away)
        start_us = pick.randrange(chaos_us // 2)
        end_us = start_us + pick.randint(2 * SECOND_US, 8 * SECOND_US)
        return [(start_us, block), (end_us, faults.Unblock(block.links))]
