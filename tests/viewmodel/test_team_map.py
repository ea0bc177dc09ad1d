"""Maps from a mission's parameters, also from such as are wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.viewmodel.team_map import map_view
from tests.support.build import action, make_mission


def mission(given: Any) -> Mission:
    return replace(make_mission(action("weld")), parameters={"map": given})


def test_lines_and_places() -> None:
    line = {"kind": "street", "points": [[0, 0], [1, 2]]}
    told = map_view(mission({"lines": [line], "places": {"p": {"at": [3, 4]}}}))
    assert told == {
        "lines": [{"kind": "street", "points": [[0.0, 0.0], [1.0, 2.0]], "closed": False}],
        "places": {"p": {"at": [3.0, 4.0], "label": "p"}},
    }


def test_without_a_map_there_is_none() -> None:
    assert map_view(make_mission(action("weld"))) is None


@pytest.mark.parametrize(
    "given",
    [
        "text",
        [],
        {},
        {"lines": 5, "places": []},
        {"lines": [{"points": [[0, 0]]}, 7]},
        {"lines": [{"points": [[0, 0], ["x", 1]]}]},
        {"lines": [{"points": [[0, 0], [float("inf"), 1]]}]},
        {"places": {"p": {"at": [1]}, "q": 5}},
    ],
)
def test_what_is_no_map_is_left_out(given: Any) -> None:
    assert map_view(mission(given)) is None
