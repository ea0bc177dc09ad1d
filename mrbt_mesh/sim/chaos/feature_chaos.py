"""How chaos meets a feature."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.sim.world.scenario import Step


class FeatureChaos:
    """What a random mission has of a feature, and what befalls it for that; nothing, as it is here.

    It draws apart, from a generator of its own, so that it changes nothing else of a mission.
    `likes_places`: its missions should have places more often than others.
    """

    likes_places = False

    def add_to_condition(self, declared: dict[str, Any]) -> None:
        """Add the feature to a declared condition, as plain data."""

    def add_to_need(self, need: dict[str, Any]) -> None:
        """Add the feature to a need of a global task, as plain data."""

    def add_to_behaviour(self, behaviour: dict[str, Any]) -> None:
        """Add to how robots behave at a local task (`random_robot`)."""

    def add(
        self, mission: dict[str, Any], robots: Sequence[str], types: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Add the feature to a mission as plain data; `types`: robot type -> what it can do."""

    def steps(self, mission: Mission, robots: Sequence[str], chaos_us: int) -> list[Step]:
        """More steps of the scenario of a mission, which is healed after `chaos_us`."""
        return []
