"""Who is whose neighbour, against the definition by brute force."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership.ring import Ring, place

names = st.text("ABCR0123456789", min_size=1, max_size=6)


@given(st.sets(names, min_size=1, max_size=40), st.integers(1, 4), names)
def test_neighbours_are_those_within_reach_on_either_side(
    robots: set[str], reach: int, newcomer: str
) -> None:
    ring = Ring(robots, reach)
    for robot in {*robots, newcomer}:
        order = sorted(robots | {robot}, key=lambda each: (place(each), each))
        at = order.index(robot)
        steps = [step for distance in range(1, reach + 1) for step in (-distance, distance)]
        expected = {order[(at + step) % len(order)] for step in steps} - {robot}
        assert ring.neighbours(robot) == tuple(sorted(expected))


@given(st.sets(names, min_size=1, max_size=40), st.integers(1, 4))
def test_neighbours_are_so_both_ways_and_all_are_in_a_small_team(
    robots: set[str], reach: int
) -> None:
    ring = Ring(robots, reach)
    for robot in robots:
        near = ring.neighbours(robot)
        assert all(robot in ring.neighbours(other) for other in near)
        assert len(near) == min(len(robots) - 1, 2 * reach)


@given(st.sets(names, min_size=1, max_size=40), st.integers(1, 4), names)
def test_who_is_near_is_a_neighbour(robots: set[str], reach: int, newcomer: str) -> None:
    ring = Ring(robots, reach)
    for robot in {*robots, newcomer}:
        near = {other for other in robots if ring.are_near(robot, other)}
        assert near == set(ring.neighbours(robot))


@given(st.lists(st.tuples(names, st.booleans())), st.integers(1, 4))
def test_a_ring_that_robots_come_to_and_leave_is_that_of_those_in_it(
    steps: list[tuple[str, bool]], reach: int
) -> None:
    ring, robots = Ring([], reach), set()
    for robot, is_in in steps:
        ring.put(robot, is_in)
        robots = robots | {robot} if is_in else robots - {robot}
        fresh = Ring(robots, reach)
        for each in {name for name, _ in steps}:
            assert ring.neighbours(each) == fresh.neighbours(each)


def test_those_that_are_alike_are_seldom_neighbours() -> None:
    robots = [f"{kind}{number}" for kind in "AB" for number in range(100)]
    ring = Ring(robots, 3)
    alike = sum(other[0] == robot[0] for robot in robots for other in ring.neighbours(robot))
    assert 0.4 < alike / (6 * len(robots)) < 0.6
