"""Ways and orders: shortest by brute force, and of the form that the standard wants."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.binding import FillError
from mrbt_mesh.adapters.vda5050.layout import (
    ActionTemplate,
    Layout,
    LayoutNode,
    RouteError,
    TaskTemplate,
)
from mrbt_mesh.adapters.vda5050.messages import read_state
from tests.support.vda5050.model_agv import ModelAgv
from tests.support.vda5050.world import stop

NAMES = "ABCDE"


@st.composite
def layouts(draw: Any) -> Layout:
    coordinates = st.integers(-5, 5)
    nodes = {name: LayoutNode(draw(coordinates), draw(coordinates)) for name in NAMES}
    pairs = [pair for pair in itertools.permutations(NAMES, 2) if draw(st.booleans())]
    edges: dict[str, dict[str, float | None]] = {name: {} for name in NAMES}
    for start, end in pairs:
        edges[start][end] = None
    return Layout("hall", nodes, edges)


def length(layout: Layout, way: tuple[str, ...] | list[str]) -> float:
    places = [layout.nodes[name] for name in way]
    return sum(math.hypot(a.x - b.x, a.y - b.y) for a, b in itertools.pairwise(places))


@given(layouts(), st.sampled_from(NAMES), st.sampled_from(NAMES))
def test_ways_are_shortest(layout: Layout, start: str, end: str) -> None:
    ways = [
        way
        for count in range(1, len(NAMES) + 1)
        for way in itertools.permutations(NAMES, count)
        if (way[0], way[-1]) == (start, end)
        and all(b in layout.edges[a] for a, b in itertools.pairwise(way))
    ]
    if not ways:
        with pytest.raises(RouteError, match=f"no way from {start} to {end}"):
            layout.way(start, end)
        return
    found = layout.way(start, end)
    assert tuple(found) in ways
    assert length(layout, found) == pytest.approx(min(length(layout, way) for way in ways))


LINE = Layout(
    "hall",
    {"A": LayoutNode(0, 0), "B": LayoutNode(4, 0, 1.5), "C": LayoutNode(8, 0)},
    {"A": {"B": 0.5}, "B": {"A": None, "C": None}, "C": {"B": None}},
)
DO = ActionTemplate(type="pick", parameters={"slot": "$slot", "n": 1})


def state_at(x: float, y: float, node: str) -> Any:
    return ModelAgv(node, x, y).state()


def test_an_order_stops_where_it_is_told_and_numbers_its_actions() -> None:
    stops = (stop("C", DO, DO), stop("B", DO))
    order = LINE.order("o1", state_at(0, 0, "A"), stops)
    assert [node.name for node in order.nodes] == ["A", "B", "C", "B"]
    assert order.action_ids == ("o1/1", "o1/2", "o1/3")
    assert [len(node.actions) for node in order.nodes] == [0, 0, 2, 1]
    assert order.last_sequence_id == 6
    assert order.speed_limits == (0.5, None, None)
    # A heading is asked for where the vehicle stops, not where it passes.
    assert [node.theta for node in order.nodes] == [None, None, None, 1.5]
    assert LINE.length_m(state_at(0, 0, "A"), stops) == 12


def test_a_vehicle_that_stopped_on_its_way_may_begin_off_its_node() -> None:
    order = LINE.order("o1", state_at(1.5, 0, "A"), (stop("B"),))
    assert order.nodes[0].deviation_m == pytest.approx(1.6)
    assert LINE.order("o1", state_at(0, 0.05, "A"), ()).nodes[0].deviation_m == 0


def test_a_stop_where_the_vehicle_stands_is_an_order_of_one_node() -> None:
    order = LINE.order("o1", state_at(0, 0, "A"), (stop("A", DO),))
    assert [(node.name, len(node.actions)) for node in order.nodes] == [("A", 1)]


def test_where_a_vehicle_begins_that_names_no_node() -> None:
    assert LINE.begin(state_at(3, 0.5, "")) == "B"
    with pytest.raises(RouteError, match=r"16\.0 m from the nearest node \(C\)"):
        LINE.begin(state_at(24, 0, "0"))
    nowhere = read_state({**ModelAgv("0").message(), "agvPosition": None})
    with pytest.raises(RouteError, match="'0' and no position"):
        LINE.begin(nowhere)


def test_two_stops_at_one_node_are_refused() -> None:
    with pytest.raises(RouteError, match="two stops at B"):
        LINE.order("o1", state_at(0, 0, "A"), (stop("B"), stop("B")))


def test_parameters_go_into_nodes_actions_and_conditions() -> None:
    task = TaskTemplate(
        parameters=["slot"], stops=(stop("rack_$slot", DO),), sets={"empty($slot)": True}
    )
    filled = task.filled(("7",))
    assert filled.sets == {"empty(7)": True}
    (only,) = filled.stops
    assert only.at == "rack_7"
    assert only.actions[0].parameters == {"slot": "7", "n": 1}
    with pytest.raises(FillError, match="other parameters: slot"):
        task.filled(())
