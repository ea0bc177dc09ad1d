"""Who lacks what conditions of a robot's own ask for, told from the tree alone."""

from __future__ import annotations

import pytest

from mrbt_mesh.sim.checkers.barriers import lacked
from tests.support.build import World, action, condition, fallback, sequence
from tests.support.per_robot_conditions import per_robot_mission


@pytest.mark.parametrize(("picked", "expected"), [(True, ""), (False, "holding")])
def test_a_condition_lets_the_team_go_on_where_an_action_has_failed(
    picked: bool, expected: str
) -> None:
    tree = sequence(fallback(action("pick"), condition("holding")), action("place"))
    world = World(per_robot_mission(tree))
    world.set("holding@A2", True, "A2")
    pick = world.activation("pick")
    for robot in world.mission.robots:
        world.outcome(pick, picked, robot)
    world.tick()
    place = world.activation("place")
    assert lacked(world.facts, place, "A1") == expected
    assert lacked(world.facts, place, "A2") == ""
