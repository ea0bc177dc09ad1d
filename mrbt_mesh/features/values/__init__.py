"""Values on the team's blackboard (`blackboard`), and conditions of each robot (`per: robot`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from mrbt_mesh.core.feature import Feature, Kit, Part

if TYPE_CHECKING:
    from mrbt_mesh.core.bt.activation import ActivationNames
    from mrbt_mesh.core.mission.conditions import ConditionType
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.features.values.chaos import OwnChaos
    from mrbt_mesh.features.values.entries import ValueEntries
    from mrbt_mesh.features.values.plan import OwnStep


class Values(Feature):
    """The feature. A mission has it in its conditions."""

    def mission_classes(self) -> Sequence[type]:
        from mrbt_mesh.features.values.traits import Traits

        return (Traits,)

    def entries(
        self, declared: Mapping[str, ConditionType], robots: Sequence[str], names: ActivationNames
    ) -> ValueEntries | None:
        if all(known.traits is None for known in declared.values()):
            return None
        from mrbt_mesh.features.values.entries import ValueEntries

        return ValueEntries(declared, robots, names)

    def plan_step(self, mission: Mission) -> OwnStep | None:
        if mission.entries.is_plain:
            return None
        from mrbt_mesh.features.values.plan import OwnStep

        return OwnStep()

    def parts(self, kit: Kit, before: Sequence[Part], now_us: int) -> Sequence[Part]:
        if kit.context.mission.entries.is_plain:
            return ()
        from mrbt_mesh.features.values.contradiction import Contradiction

        return before or (Contradiction(kit),)

    def chaos(self, seed: int) -> OwnChaos:
        from mrbt_mesh.features.values.chaos import OwnChaos

        return OwnChaos(seed)


FEATURE = Values()
