"""The robustness benchmark: its draws, its bounds, and our team against them."""

from __future__ import annotations

import random
from itertools import product

import pytest

from benchmarks.robustness.bounds import BestPolicy, allows, possible
from benchmarks.robustness.draws import ACTIONS, CELLS, ROOMS, Cell, Draw, before, draw
from benchmarks.robustness.results import Judged, markdown, summary
from benchmarks.robustness.teams import independent_robots, our_team

ALL_DONE = (1 << ACTIONS) - 1


def small_draw(seed: int) -> Draw:
    """Two or three robots of any capabilities and lives."""
    chance = random.Random(f"small/{seed}")
    robots = range(chance.randint(2, 3))
    able = tuple(
        frozenset(r for r in robots if chance.random() < 0.6) or frozenset({chance.choice(robots)})
        for _ in range(ACTIONS)
    )
    return Draw(seed, able, tuple(chance.randint(1, 6) for _ in robots))


def can_be_played(draw: Draw) -> bool:
    """Brute force over plays, in their order: (what is done, actions left of each robot)."""
    states = {(0, draw.lives)}
    for _ in range(ACTIONS):
        following = set()
        for done, left in states:
            for action, robot in product(possible(done), range(len(left))):
                if left[robot] and robot in draw.able[action]:
                    after = (*left[:robot], left[robot] - 1, *left[robot + 1 :])
                    following.add((done | 1 << action, after))
        states = following
    return bool(states)


def test_the_bound_is_what_brute_force_over_all_orders_finds() -> None:
    found = []
    for seed in range(60):
        luck = small_draw(seed)
        assert allows(luck) == can_be_played(luck), f"seed {seed}: {luck}"
        found.append(allows(luck))
    assert 10 < sum(found) < 50, "the cases tell nothing"


@pytest.mark.parametrize("cell", CELLS, ids=str)
def test_a_draw_gives_each_capability_to_as_many_robots_as_the_setting_says(cell: Cell) -> None:
    for seed in range(20):
        luck = draw(cell, seed)
        assert {len(able) for able in luck.able} == {cell.able}, f"seed {seed}"
        assert all(luck.capabilities(robot) for robot in range(cell.robots)), f"seed {seed}"
        assert len(luck.lives) == cell.robots
        assert luck == draw(cell, seed)
    assert draw(cell, 0) != draw(cell, 1)


def test_lives_are_geometric() -> None:
    for fault in (10, 30, 50):
        cell = Cell(8, 100, fault, 0)
        lives = [life for seed in range(1_000) for life in draw(cell, seed).lives]
        mean, deviation = 100 / fault, (1 - fault / 100) ** 0.5 / (fault / 100)
        error = deviation / len(lives) ** 0.5
        assert abs(sum(lives) / len(lives) - mean) < 5 * error
        first = sum(life == 1 for life in lives) / len(lives)
        assert abs(first - fault / 100) < 5 * 0.5 / len(lives) ** 0.5


def test_with_equal_robots_the_policy_knows_all_that_there_is_to_know() -> None:
    """P(Bin(7, FP) <= 3): of the first seven completions at most three may be deaths."""
    for fault, expected in ((10, 0.99727), (30, 0.87396), (50, 0.5)):
        luck = draw(Cell(4, 100, fault, 0), 0)
        assert BestPolicy(luck.able, 4, fault).chance == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("fault", [30, 50])
def test_the_policy_succeeds_as_often_as_it_says(fault: int) -> None:
    able = draw(Cell(4, 50, fault, 0), 3).able
    policy = BestPolicy(able, 4, fault)
    runs = 4_000
    plays = []
    for seed in range(runs):
        luck = Draw(seed, able, draw(Cell(4, 100, fault, 0), seed).lives)
        plays.append(policy.succeeds(luck))
        assert allows(luck) or not plays[-1], f"seed {seed}: better than possible"
    error = (policy.chance * (1 - policy.chance) / runs) ** 0.5
    assert 0 < policy.chance < 1
    assert abs(sum(plays) / runs - policy.chance) < 5 * error


def test_no_other_policy_is_better_in_a_case_worked_out_by_hand() -> None:
    """A specialist for one action, and two robots for the rest: never waste the specialist."""
    able = (frozenset({0}), *[frozenset({0, 1, 2})] * (ACTIONS - 1))
    policy = BestPolicy(able, 3, 50)
    # The specialist's own action comes first or its life is at risk before it.
    done, alive = 0, 0b111
    seen = []
    while done != ALL_DONE:
        choice = policy.choice(done, alive)
        assert choice is not None
        seen.append(choice)
        done |= 1 << choice[0]
    assert (0, 0) in seen
    assert all(robot != 0 for action, robot in seen[: seen.index((0, 0))] if action)


def test_ours_succeeds_exactly_when_the_bound_allows_it_if_all_robots_are_equal() -> None:
    found = []
    for seed in range(20):
        luck = draw(Cell(4, 100, (30, 50)[seed % 2], 0), seed)
        assert our_team(luck)[0] == allows(luck), f"seed {seed}: {luck}"
        found.append(allows(luck))
    assert any(found)
    assert not all(found)


@pytest.mark.parametrize("homogeneity", [25, 50])
def test_nobody_does_better_than_the_bound(homogeneity: int) -> None:
    for seed in range(5):
        luck = draw(Cell(4, homogeneity, 30, 0), seed)
        assert our_team(luck)[0] <= allows(luck), f"seed {seed}"
        assert independent_robots(luck) <= allows(luck), f"seed {seed}"


def test_robots_that_never_die_succeed_even_without_telling_one_another() -> None:
    able = draw(Cell(4, 25, 10, 0), 0).able
    assert independent_robots(Draw(1, able, (99,) * 4))
    assert our_team(Draw(1, able, (99,) * 4))[0]


def test_independent_robots_waste_effort() -> None:
    """Two robots that can do everything, each lives four actions: nothing may be done twice."""
    everybody = (frozenset({0, 1}),) * ACTIONS
    outcomes = [independent_robots(Draw(seed, everybody, (4, 4))) for seed in range(6)]
    assert not all(outcomes)
    assert our_team(Draw(0, everybody, (4, 4)))[0]


def test_what_comes_before_what() -> None:
    assert [before(a) for a in range(ROOMS)] == [()] * ROOMS
    assert [before(a) for a in range(ROOMS, ACTIONS)] == [(0, 1), (1, 2), (2, 3), (3, 0)]
    assert possible(0b0011) == [2, 3, 4]
    assert possible(ALL_DONE) == []


def test_the_table_has_a_row_per_published_figure() -> None:
    cells = {(cell.robots, cell.homogeneity, cell.fault): cell.published for cell in CELLS}
    four = {(4, h, fp) for h in (25, 50, 75, 100) for fp in (10, 30, 50)}
    assert cells.keys() == four | {(8, 100, fp) for fp in (10, 30, 50)}
    assert cells[4, 25, 10] == 41.4
    assert cells[4, 100, 50] == 10.4
    assert cells[8, 100, 30] == 92.2
    won, lost = (True, 2.0), (False, 5.0)
    judged = [Judged(won, False, True, True, 0.5), Judged(lost, False, True, False, 0.25)]
    rows = [summary(cell, judged) for cell in CELLS]
    assert rows[0]["ours"] == 50.0
    assert rows[0]["best_policy_expected"] == 37.5
    assert rows[0]["median_success_s"] == 2.0
    assert (rows[0]["allowed_but_failed"], rows[0]["succeeded_but_not_allowed"]) == (1, 0)
    table = markdown(rows).splitlines()
    assert len(table) == 2 + len(CELLS)
    assert len({line.count("|") for line in table}) == 1
    assert table[2] == "| 4 | 0.25 | 0.1 | 41.4 | 0.0 | 50.0 | 50.0 | 100.0 |"
