"""CBAA against the paper's guarantees, and examples worked out by hand."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.cbaa import (
    Outcome,
    cbaa,
    complete,
    distances,
    flooding,
    judge,
    line,
    ring,
    slots,
)
from benchmarks.instances import Density, Instance, Spec, Values, draw

NETWORKS = {"complete": complete, "ring": ring, "line": line}


def random_values(seed: int, highest: int) -> NDArray[np.int64]:
    """Two to five robots and tasks; some robots cannot do some tasks."""
    chance = np.random.default_rng(seed)
    shape = chance.integers(2, 6, size=2)
    values = chance.integers(1, highest + 1, shape)
    return np.where(chance.random(shape) < 0.8, values, 0)


def best(values: NDArray[np.int64]) -> int:
    """The optimum of one task per robot, by brute force."""
    robots, tasks = values.shape
    padded = np.hstack([values, np.zeros((robots, robots), dtype=np.int64)])  # to stay idle
    rows = np.arange(robots)
    return max(
        int(padded[rows, c].sum()) for c in map(list, permutations(range(tasks + robots), robots))
    )


def sequential_greedy(values: NDArray[np.int64]) -> dict[int, int]:
    """The highest bid first; of equal ones the lower robot's, then the lower task's."""
    left = values.copy()
    found = {}
    while left.any():
        robot, task = divmod(int(np.argmax(left)), values.shape[1])
        found[robot] = task
        left[robot, :] = left[:, task] = 0
    return found


def check(values: NDArray[np.int64], outcome: Outcome) -> int:
    """Conflict-free and as everybody believes; returns the score."""
    taken = [(robot, task) for robot, task in enumerate(outcome.taken) if task >= 0]
    assert len({task for _, task in taken}) == len(taken)
    assert {t: r for t, r in enumerate(outcome.winners) if r >= 0} == {t: r for r, t in taken}
    assert all(values[robot, task] > 0 for robot, task in taken)
    return sum(int(values[robot, task]) for robot, task in taken)


def test_two_robots_by_hand() -> None:
    """Both bid for task 0 and the second is outbid; then it can only take task 1. The best
    would be 9 + 8."""
    values = np.array([[10, 9], [8, 1]])
    outcome = cbaa(values, complete(2))
    assert outcome.taken == (0, 1)
    assert outcome.winners == (0, 1)
    assert (outcome.rounds, outcome.messages) == (2, 4)
    assert check(values, outcome) == 11
    assert best(values) == 17


def test_a_line_of_three_by_hand() -> None:
    """The ends want the same task and hear of each other in the second round; the loser's new
    bid needs two more."""
    values = np.array([[9, 2], [0, 0], [8, 3]])
    outcome = cbaa(values, line(3))
    assert outcome.taken == (0, -1, 1)
    assert (outcome.rounds, outcome.messages) == (4, 16)


def test_bytes_are_those_of_the_lists() -> None:
    """Two robots, one task, one round each way: a bid and a bidder."""
    outcome = cbaa(np.array([[5], [4]]), complete(2))
    assert outcome.rounds == 1
    assert outcome.bytes == 2 * (1 + 2 + 2)


@pytest.mark.slow
@pytest.mark.parametrize("links", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("highest", [1000, 3])
@pytest.mark.parametrize("spread", [False, True])
def test_guarantees_of_single_assignment(links, highest: int, spread: bool) -> None:  # type: ignore[no-untyped-def]
    """Conflict-free, at least half the optimum, as soon as promised."""
    for seed in range(12):
        values = random_values(seed, highest)
        reach = links(len(values))
        diameter = int(distances(reach).max())
        outcome = cbaa(values, reach, spread=spread)
        assert 2 * check(values, outcome) >= best(values), f"seed {seed}"
        assert outcome.rounds <= min(values.shape) * diameter, f"seed {seed}"
        if not spread:
            greedy = sequential_greedy(values)
            taken = {r: task for r, task in enumerate(outcome.taken) if task >= 0}
            assert taken == greedy, f"seed {seed}: not what sequential greedy finds"


def test_equal_bids_go_to_the_lower_number_whoever_asks_first() -> None:
    values = np.ones((4, 2), dtype=np.int64)
    for links in NETWORKS.values():
        outcome = cbaa(values, links(4))
        assert outcome.taken == (0, 1, -1, -1)


def test_a_robot_without_neighbours_in_a_team_of_one() -> None:
    outcome = cbaa(np.array([[3, 4]]), complete(1))
    assert (outcome.taken, outcome.rounds, outcome.messages) == ((1,), 0, 0)


def test_networks() -> None:
    assert distances(line(5)).max() == 4
    assert distances(ring(5)).max() == 2
    assert distances(complete(5)).max() == 1
    assert ring(2).sum() == 2
    with pytest.raises(ValueError, match="not connected"):
        distances(np.zeros((2, 2), dtype=np.bool_))


def test_flooding_by_hand() -> None:
    sizes = np.array([10, 20, 30])
    assert flooding(complete(3), sizes) == (1, 6, 120)
    # On a line the ends send their own and then nothing new; the middle its own, then both ends'.
    assert flooding(line(3), sizes) == (2, 8, 10 + 30 + 2 * 60 + 20 + 20)


def test_slots_keep_upper_bounds_and_prefer_lower_ones() -> None:
    """One good robot for two demands: without a bonus it fills up the better paid one."""
    instance = Instance(
        2,
        np.array([1, 1]),
        np.array([2, 1]),
        np.array([0, 0, 1, 1]),
        np.array([0, 1, 0, 1]),
        np.array([9, 1, 8, 1]),
    )
    plain, with_bonus = slots(instance, bonus=False), slots(instance, bonus=True)
    assert plain.demand.tolist() == [0, 0, 1]
    assert plain.values.tolist() == [[9, 9, 1], [8, 8, 1]]
    assert with_bonus.values.tolist() == [[19, 9, 11], [18, 8, 11]]
    links = complete(2)
    greedy = plain.choice(cbaa(plain.values, links))
    assert greedy.tolist() == [0, 0]
    verdict = judge(instance, greedy)
    assert (verdict.score, verdict.usable, verdict.missed) == (17, 17, 1)
    kept = with_bonus.choice(cbaa(with_bonus.values, links))
    assert kept.tolist() == [0, 1]
    assert judge(instance, kept).missed == 0
    with pytest.raises(ValueError, match="upper bound"):
        judge(instance, np.array([1, 1]))


def test_what_cannot_begin_is_not_usable() -> None:
    instance = Instance(
        1, np.array([2]), np.array([2]), np.array([0]), np.array([0]), np.array([7])
    )
    verdict = judge(instance, np.array([0]))
    assert (verdict.score, verdict.usable, verdict.missed) == (7, 0, 1)


@pytest.mark.parametrize("density", Density)
@pytest.mark.parametrize("values", Values)
def test_on_drawn_instances(density: Density, values: Values) -> None:
    for seed in range(5):
        instance = draw(Spec(12, 6, density, values, seed))
        for bonus in (False, True):
            tasks = slots(instance, bonus)
            outcome = cbaa(tasks.values, complete(12), spread=True)
            check(tasks.values, outcome)
            judge(instance, tasks.choice(outcome))
