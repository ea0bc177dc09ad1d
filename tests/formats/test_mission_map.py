"""Maps from a mission's parameters, also from such as are wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.formats.mission_map import map_view, place_states, told_places
from tests.support.build import action, condition, make_mission, sequence


def mission(given: Any) -> Mission:
    return replace(make_mission(action("weld")), parameters={"map": given})


def test_lines_and_places() -> None:
    line = {"kind": "street", "points": [[0, 0], [1, 2]]}
    told = map_view(mission({"lines": [line], "places": {"p": {"at": [3, 4]}}}))
    assert told == {
        "lines": [{"kind": "street", "points": [[0.0, 0.0], [1.0, 2.0]], "closed": False}],
        "places": {"p": {"at": [3.0, 4.0], "label": "p"}},
        "ways": [],
    }


def test_ways_between_places_of_the_map_are_told_once() -> None:
    ways_ms = {("p", "q"): 4_000, ("q", "p"): 5_000, ("p", "elsewhere"): 1_000, ("p", "p"): 1}
    travel = Travel({"p": None, "q": None, "elsewhere": None}, {}, {}, ways_ms=ways_ms)
    there = mission({"places": {"p": {"at": [3, 4]}, "q": {"at": [5, 5]}}})
    told = map_view(replace(there, travel=travel))
    assert told is not None
    assert told["ways"] == [["p", "q"]]


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


WELD = {"at": [0, 0], "bad": "broken", "checked": "look", "mended": "weld"}


@pytest.mark.parametrize(
    ("place", "done", "is_broken", "state"),
    [
        (WELD, (), False, "unknown"),
        (WELD, ("look",), False, "good"),
        (WELD, ("look",), True, "bad"),
        (WELD, (), True, "bad"),
        (WELD, ("look", "weld"), True, "good"),
        ({"bad": "no_such_condition", "mended": 5, "checked": []}, ("look",), True, "unknown"),
    ],
)
def test_the_state_of_a_place(
    place: Any, done: tuple[str, ...], is_broken: bool, state: str
) -> None:
    known = ["broken"] if is_broken else []
    team = make_mission(sequence(condition("broken"), action("weld")), true_at_first=known)
    team = replace(team, parameters={"map": {"places": {"p": place, "q": {"at": [1, 1]}}}})
    assert place_states(told_places(team), TeamFacts(team, "r1"), done.__contains__) == {"p": state}


@pytest.mark.parametrize("given", [None, {"places": {"q": {"at": [1, 1]}}}, {"places": {"q": 5}}])
def test_places_of_which_nothing_is_told(given: Any) -> None:
    team = mission(given)
    assert told_places(team) == {}
