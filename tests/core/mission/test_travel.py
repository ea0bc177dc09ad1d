"""Ways between places."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.mission.travel import MAX_MS, MICRO, Travel
from mrbt_mesh.core.scheduling.problem import Objective

TRAVEL = Travel(
    {"dock": (0, 0), "gate": (3 * MICRO, 4 * MICRO), "yard": (1, 0)},
    {"lift(1)": "gate"},
    {"A1": "dock"},
    {"cart": 2 * MICRO, "drone": 3 * MICRO},
    {("dock", "yard"): 700, ("yard", "gate"): 10, ("gate", "yard"): 20},
    Objective.MEAN_COMPLETION,
    True,
    7,
)


@pytest.mark.parametrize(
    ("robot_type", "origin", "goal", "ms"),
    [
        ("cart", "dock", "gate", 2_500),
        ("drone", "gate", "dock", 1_667),
        ("drone", "dock", "yard", 700),
        ("drone", "yard", "dock", 700),
        ("cart", "yard", "gate", 10),
        ("cart", "gate", "yard", 20),
        ("cart", "gate", "gate", 0),
    ],
)
def test_how_long_a_way_takes(robot_type: str, origin: str, goal: str, ms: int) -> None:
    assert TRAVEL.way_ms(robot_type, origin, goal) == ms


def test_it_is_taken_back_from_its_plain_data() -> None:
    assert Travel.from_json(TRAVEL.to_json()) == TRAVEL


def test_ways_that_nobody_needs_are_long_in_the_table() -> None:
    only = Travel({"a": None, "b": None, "c": (0, 0)}, {}, {}, {}, {("a", "b"): 5})
    assert only.table("cart") == [[0, 5, MAX_MS], [5, 0, MAX_MS], [MAX_MS, MAX_MS, 0]]
    with pytest.raises(KeyError):
        only.way_ms("cart", "a", "c")
