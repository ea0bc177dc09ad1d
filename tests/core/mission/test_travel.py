"""Ways between places."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.codec import Codec
from mrbt_mesh.core.mission.travel import MAX_MS, MICRO, Travel, ways_between
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
    data = json.loads(json.dumps(Codec().write(Travel, TRAVEL)))
    assert Codec().read(Travel, data) == TRAVEL


def test_ways_that_nobody_needs_are_long_in_the_table() -> None:
    only = Travel({"a": None, "b": None, "c": (0, 0)}, {}, {}, {}, {("a", "b"): 5})
    assert only.table("cart") == [[0, 5, MAX_MS], [5, 0, MAX_MS], [MAX_MS, MAX_MS, 0]]
    with pytest.raises(KeyError):
        only.way_ms("cart", "a", "c")


@given(
    st.lists(st.tuples(st.integers(0, 50_000), st.integers(0, 50_000)), min_size=2, max_size=6),
    st.integers(0, 80_000),
)
def test_the_ways_from_between_two_places_are_those_on_the_map(
    points: list[tuple[int, int]], left_ms: int
) -> None:
    table = [[round(math.dist(a, b)) for b in points] for a in points]
    whole_ms = table[0][1]
    part = max(0.0, 1 - left_ms / whole_ms) if whole_ms else 0.0
    here = tuple(a + (b - a) * part for a, b in zip(*points[:2], strict=True))
    for there, ms in zip(points, ways_between(table, 0, 1, left_ms), strict=True):
        # Ways are rounded to milliseconds, which matters most near to a place.
        assert abs(ms - math.dist(here, there)) <= 2 + math.sqrt(2 * whole_ms)


@given(st.data())
def test_no_way_from_between_is_longer_than_by_way_of_a_place(data: st.DataObject) -> None:
    row = st.lists(st.integers(0, MAX_MS), min_size=3, max_size=3)
    table = data.draw(st.lists(row, min_size=3, max_size=3))
    whole_ms = table[0][1]
    left_ms = data.draw(st.integers(0, whole_ms))
    found = ways_between(table, 0, 1, left_ms)
    assert all(ms >= 0 for ms in found)
    if left_ms == whole_ms:
        assert list(found) == table[0], "nothing changes by setting out"
    else:
        assert all(ms <= left_ms + on_ms for ms, on_ms in zip(found, table[1], strict=True))
