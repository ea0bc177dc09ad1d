"""Ways over the floor: they are free, they end where they should, none is shorter."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from itertools import pairwise

import pytest
from bodies.driving import (
    CELL_M,
    HIT_MARGIN_M,
    REMEMBERED_S,
    Floor,
    Place,
    Sights,
    Site,
    kept_off,
)
from bodies.messages import RANGE_M, RAYS, Senses
from hypothesis import given
from hypothesis import strategies as st

BLOCK = (-1.0, -0.5, 1.0, 0.5)
LANE = (1.5, -2.0, 2.5, 2.0)
FLOOR = Floor(Site((-4.0, -3.0, 4.0, 3.0), (BLOCK,), (LANE,)), 0.28)
OPEN = Floor(Site((-4.0, -3.0, 4.0, 3.0), (), ()), 0.28)
places = st.tuples(st.floats(-3.5, 3.5), st.floats(-2.5, 2.5))


def senses(x: float = 0.0, y: float = 0.0, time_s: float = 0.0, **hits: float) -> Senses:
    """A robot that looks along x, with hits by number of their ray: `r0=2.0`."""
    ranges = [RANGE_M] * RAYS
    for name, range_m in hits.items():
        ranges[int(name[1:])] = range_m
    return Senses(time_s, x, y, 0.0, 0.0, 0.0, 0.0, tuple(ranges), None, None)


@given(places, places, st.lists(places, max_size=4))
def test_a_way_is_free_and_ends_at_its_goal(start: Place, goal: Place, hits: list[Place]) -> None:
    way = FLOOR.plan(start, [goal], hits)
    if not way:
        return
    assert way[-1] == goal
    assert not FLOOR.is_taken(goal, hits)
    for place in way[:-1]:
        near = math.dist(place, start) <= 0.85
        assert near or FLOOR.is_free(place)
        keep = FLOOR.radius_m + HIT_MARGIN_M - 1e-9
        assert near or all(math.dist(place, hit) >= keep for hit in hits)
    for before, after in pairwise(way[:-1]):
        assert math.dist(before, after) <= CELL_M * math.sqrt(2) + 1e-9


@given(places, places)
def test_there_is_a_way_wherever_one_can_walk(start: Place, goal: Place) -> None:
    if not FLOOR.is_free(start) or not FLOOR.is_free(goal):
        return
    assert FLOOR.plan(start, [goal], [])


@given(places, places)
def test_no_way_is_longer_than_it_must_be(start: Place, goal: Place) -> None:
    """On an open floor the fewest steps are known: as many as the longer side has."""
    if not OPEN.is_free(start) or not OPEN.is_free(goal):
        return
    ends = [
        [math.floor((v + b) / CELL_M) for v, b in zip(p, (4, 3), strict=True)]
        for p in (start, goal)
    ]
    steps = max(abs(a - b) for a, b in zip(*ends, strict=True))
    assert len(OPEN.plan(start, [goal], [])) == max(1, steps)


def test_a_way_leads_round_what_stands_there() -> None:
    way = FLOOR.plan((0.0, -1.5), [(0.0, 1.5)], [])
    assert max(abs(x) for x, _ in way) > 1.0 + 0.28
    west = [(1.4 + 0.1 * i, y) for i in range(30) for y in (-1.0, 0.0, 1.0)]
    assert max(x for x, _ in FLOOR.plan((0.0, -1.5), [(0.0, 1.5)], west)) < 1.0


def test_the_nearest_goal_is_chosen_unless_it_is_taken() -> None:
    near, far = (-2.0, -1.5), (3.0, -1.5)
    assert FLOOR.plan((-3.0, -1.5), [far, near], [])[-1] == near
    assert FLOOR.plan((-3.0, -1.5), [far, near], [(-2.0, -1.2)])[-1] == far
    assert FLOOR.plan((-3.0, -1.5), [far, near], [(-2.0, -1.0)])[-1] == near
    assert FLOOR.plan((-3.0, -1.5), [near], [near]) == []


def test_a_robot_that_was_pushed_to_where_it_should_not_be_gets_out() -> None:
    start = (1.05, 0.0)
    assert not FLOOR.is_free(start)
    assert FLOOR.plan(start, [(3.0, 0.0)], [])[-1] == (3.0, 0.0)


def test_docks_are_within_reach_free_and_in_no_lane() -> None:
    target = (0.9, 0.0)
    docks = FLOOR.docks(target, 0.75, 1.35)
    assert docks
    for x, y in docks:
        assert 0.749 <= math.dist((x, y), target) <= 1.351
        assert FLOOR.is_free((x, y))
        assert not 1.5 <= x <= 2.5
    assert set(docks) < set(FLOOR.docks(target, 0.75, 1.35, in_lanes=True))
    # Seen from all sides from which it can be reached.
    assert {y > 0 for _, y in docks} == {True, False}


def test_one_goes_straight_only_where_it_is_free() -> None:
    assert FLOOR.sees((-3, -2), (3, -2), [])
    assert not FLOOR.sees((-3, 0), (3, 0), [])
    assert not FLOOR.sees((-3, -2), (3, -2), [(0, -2.2)])
    assert FLOOR.sees((-3, -2), (3, -2), [(0, -2.5)])
    way = [(-2.8, -2.0), (-2.5, -2.0), (-2.1, -2.0), (-1.9, -2.0)]
    assert FLOOR.aim((-3.0, -2.0), way, []) == (-2.1, -2.0)
    assert FLOOR.aim((-3.0, -2.0), way, [(-2.1, -2.0)]) == way[0]


def test_what_stands_there_for_good_is_not_news() -> None:
    sights = Sights(FLOOR)
    # The wall is 3 m ahead of where x is 1, the block 1 m behind the robot at x 2.
    assert sights.look(senses(1.0, 2.0, r0=3.0)) == []
    assert sights.look(senses(2.0, 0.0, **{f"r{RAYS // 2}": 1.0})) == []
    # Of anything else one does not see how thick it is: as thick as a robot.
    thick = [(3.0, 0.0), (3.2, 0.0), (3.4, 0.0)]
    assert sights.look(senses(2.0, 0.0, r0=1.0)) == [pytest.approx(each) for each in thick]


def test_what_is_out_of_sight_is_remembered_for_a_while() -> None:
    sights = Sights(OPEN)
    seen = set(sights.look(senses(0.0, 0.0, 0.0, r0=1.0)))
    # From beyond something that hides it, it is still known.
    hidden = senses(-1.0, 0.0, 5.0, r0=0.5)
    new = {(-0.5, 0.0), (-0.3, 0.0), (-0.1, 0.0)}
    found = {(round(x, 6), round(y, 6)) for x, y in sights.look(hidden)}
    assert found == seen | new
    late = replace(hidden, time_s=REMEMBERED_S + 1)
    assert len(sights.look(late)) == len(new)


def test_what_has_gone_is_forgotten_at_once() -> None:
    sights = Sights(OPEN)
    assert sights.look(senses(0.0, 0.0, 0.0, r0=1.0))
    assert sights.look(senses(0.0, 0.0, 0.1)) == []


@given(places, st.lists(places, max_size=3), st.floats(-1, 1), st.floats(-1, 1))
def test_nobody_drives_into_what_is_near(
    here: Place, hits: list[Place], east: float, north: float
) -> None:
    near = [hit for hit in hits if 0 < math.dist(here, hit) < 0.4]
    x, y = kept_off(east, north, here, hits[:1], 0.4)
    if near == hits[:1] and near:
        assert x * (near[0][0] - here[0]) + y * (near[0][1] - here[1]) <= 1e-9
    assert math.hypot(x, y) <= math.hypot(east, north) + 1e-9


@pytest.mark.parametrize("goal", [(0.0, 0.0), (3.9, 0.0)])
def test_where_nobody_can_stand_is_reached_from_nowhere(goal: Place) -> None:
    """Counted with another search: cells that are free and hang together."""
    assert not FLOOR.is_free(goal)
    seen = {(30, 10)}
    queue = deque(seen)
    while queue:
        i, j = queue.popleft()
        for di, dj in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            cell = (i + di, j + dj)
            middle = (-4 + (cell[0] + 0.5) * CELL_M, -3 + (cell[1] + 0.5) * CELL_M)
            if cell not in seen and FLOOR.is_free(middle):
                seen.add(cell)
                queue.append(cell)
    assert len(seen) > 500
    assert (math.floor((goal[0] + 4) / CELL_M), math.floor((goal[1] + 3) / CELL_M)) not in seen
