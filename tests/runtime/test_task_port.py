"""Positions as robots' programs tell them, and who hears of them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.runtime.task_port import milli_position
from mrbt_mesh.views.model.team_view import TeamView
from tests.support.runs import run_example


def test_in_thousandths_and_within_one_turn() -> None:
    assert milli_position(1.5, -2, None) == Position(1_500, -2_000)
    assert milli_position(0, 0, math.pi / 2) == Position(0, 0, 1_571)
    assert milli_position(0, 0, 5 * math.pi / 2) == Position(0, 0, 1_571)


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e6 + 1, "1", True, None])
def test_what_is_no_position_is_the_programs_fault(number: Any) -> None:
    with pytest.raises(ValueError, match="a position consists of numbers"):
        milli_position(number, 0, None)


def test_couriers_are_seen_where_they_have_delivered() -> None:
    """The last thing that each courier said stands at a destination, or at its station."""
    result = run_example("couriers", 1)
    view = TeamView(result.observer)
    view.update(result.duration_us)
    items = view.changes.since(0)
    parameters = result.observer.mission.parameters
    ends = [tuple(map(float, to)) for _, to in parameters["parcels"].values()]
    ends += [tuple(map(float, at)) for at in parameters["stations"].values()]
    positions = {k: (v["x"], v["y"]) for k, v in items.items() if k.startswith("position/")}
    assert len(positions) == 4
    assert set(positions.values()) <= set(ends)
    assert {items[f"place/{name}"] for name in parameters["parcels"]} == {"good"}
