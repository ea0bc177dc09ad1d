"""Names of conditions that every robot has for itself."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import mission_from_json
from mrbt_mesh.features.values.traits import Traits
from tests.support.build import action, condition, fallback, inverter, make_mission, sequence
from tests.support.per_robot_conditions import TREE, per_robot_mission


@pytest.mark.parametrize(
    ("name", "can_be_set"),
    [
        ("holding@A1", True),
        ("holding@B-1", True),
        ("holding", False),
        ("holding@", False),
        ("holding@A3", False),
        ("holding@A1@A2", False),
        ("@A1", False),
        ("lid", True),
        ("lid@A1", False),
        ("lid@", False),
        ("dark", False),
    ],
)
def test_which_conditions_robots_may_set(name: str, can_be_set: bool) -> None:
    assert per_robot_mission(TREE, ConditionType("lid")).entries.can_be_set(name) is can_be_set


def test_a_robots_own_condition_may_have_arguments() -> None:
    """`holding(cup)` is read by the tree, `holding(cup)@A1` is one robot's value."""
    holding = ConditionType("holding", ("item",), default=True, traits=Traits(per_robot=True))
    tree = sequence(fallback(condition("holding(cup)"), action("pick")), action("place"))
    mission = replace(per_robot_mission(tree), conditions={"holding": holding})
    assert mission.entries.is_own("holding(cup)")
    assert not mission.entries.is_own("holding(cup)@A1")
    assert [mission.entries.can_be_set(f"holding({a})@A1") for a in ("cup", "box", "cup,box")] == [
        1,
        1,
        0,
    ]
    facts = TeamFacts(mission, "r")
    assert facts.condition("holding(cup)")
    assert facts.condition("holding(cup)@A1")
    assert facts.condition_of("A1", "holding(cup)")


def test_what_is_each_robots_own_is_kept_when_compiled() -> None:
    mission = per_robot_mission(TREE)
    again = mission_from_json(mission.to_json())
    assert again.digest == mission.digest
    assert again.conditions == mission.conditions
    assert again.digest != make_mission(TREE, {r: {} for r in mission.robots}).digest


def test_guards_that_robots_read_their_own_way() -> None:
    """Node 3 is `pick`, node 4 `place`."""
    assert per_robot_mission(TREE).entries.guards == {
        3: (("holding", True),),
        4: (("holding", False),),
    }
    compound = sequence(condition("lid"), inverter(condition("holding")))
    tree = sequence(fallback(compound, action("pick")), action("place"))
    guards = per_robot_mission(tree).entries.guards
    assert {name for rows in guards.values() for name, _ in rows} == {"#2"}
    assert make_mission(TREE).entries.guards == {}
