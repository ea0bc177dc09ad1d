"""Missions with a condition that every robot has for itself."""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.core.bt.tree import NodeSpec
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.values.traits import Traits
from tests.support.build import action, condition, fallback, make_mission, sequence

HOLDING = ConditionType("holding", (), default=False, traits=Traits(per_robot=True))


def per_robot_mission(tree: NodeSpec, *others: ConditionType) -> Mission:
    """Three robots, each with its own `holding`."""
    robots = {name: {"pick": 1.0, "place": 1.0} for name in ("A1", "A2", "B-1")}
    mission = make_mission(tree, robots)
    known = {each.name: each for each in (HOLDING, *others)}
    return replace(mission, conditions=dict(mission.conditions) | known)


TREE = sequence(fallback(condition("holding"), action("pick")), action("place"))
