"""CBAA and CBBA against the paper: its table, its guarantees, and examples worked out by hand."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.cbba import network
from benchmarks.cbba.cbaa import cbaa
from benchmarks.cbba.cbba import cbba, table_1
from benchmarks.cbba.outcome import Outcome
from benchmarks.cbba.scoring import DiscountedTours, Scoring, SingleTask
from benchmarks.cbba.slots import judge, slots
from benchmarks.instances import Density, Instance, Spec, Values, draw

NETWORKS = {
    "complete": network.complete,
    "ring": network.ring,
    "line": network.line,
    "random": lambda robots: network.random(robots, 7),
}


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
    taken = [(robot, task) for robot, path in enumerate(outcome.paths) for task in path]
    assert len({task for _, task in taken}) == len(taken)
    assert {t: r for t, r in enumerate(outcome.winners) if r >= 0} == {t: r for r, t in taken}
    assert all(values[robot, task] > 0 for robot, task in taken)
    return sum(int(values[robot, task]) for robot, task in taken)


# Table I, as it is printed. Whom the sender k, then whom the receiver i thinks the winner: i, k,
# m (the sender's third party), n (another third party of the receiver's), or - for nobody.
ALWAYS = {
    ("k", "k"): "update",
    ("k", "-"): "update",
    ("i", "i"): "leave",
    ("i", "k"): "reset",
    ("i", "-"): "leave",
    ("-", "i"): "leave",
    ("-", "k"): "update",
    ("-", "-"): "leave",
}


def act(lines: tuple[str, str], higher: bool, m: int, n: int) -> str:
    """The action; `m` and `n` are 1 where the sender's news of them is younger, -1 older."""
    if lines in ALWAYS:
        return ALWAYS[lines]
    conditions = {
        ("k", "i"): (higher, "update"),
        ("k", "n"): (n > 0 or higher, "update"),
        ("i", "n"): (n > 0, "reset"),
        ("-", "n"): (n > 0, "update"),
        ("m", "i"): (m > 0 and higher, "update"),
        ("m", "m"): (m > 0, "update"),
        ("m", "-"): (m > 0, "update"),
    }
    if lines in conditions:
        holds, action = conditions[lines]
        return action if holds else "leave"
    if lines == ("m", "k"):
        return "update" if m > 0 else "reset"
    assert lines == ("m", "n")
    if m > 0 and (n > 0 or higher):
        return "update"
    return "reset" if n > 0 and m < 0 else "leave"


NONE, RECEIVER, SENDER = 4, 0, 1


def role(winner: int, third: str) -> str:
    return {RECEIVER: "i", SENDER: "k", NONE: "-"}.get(winner, third)


def test_all_lines_of_table_1() -> None:
    """Receiver 0, sender 1, third parties 2 and 3, nobody 4; older and younger news of both."""
    seen = set()
    for zk, zi, of_2, of_3 in product(range(5), range(5), (-1, 0, 1), (-1, 0, 1)):
        for yk, yi in ((5, 5), (4, 6), (6, 4)):
            yk, yi = (0 if zk == NONE else yk), (0 if zi == NONE else yi)
            message = np.array([yk]), np.array([zk]), np.array([9, 9, 5 + of_2, 5 + of_3, 0])
            own = np.array([[yi]]), np.array([[zi]]), np.array([[0, 7, 5, 5, 0]])
            update, reset = table_1(SENDER, np.array([RECEIVER]), message, *own)
            found = "update" if update[0, 0] else "reset" if reset[0, 0] else "leave"
            lines = role(zk, "m"), role(zi, "m" if zk == zi else "n")
            news = {2: of_2, 3: of_3}
            higher = yk > yi or (yk == yi and zk < zi)
            expected = act(lines, higher, news.get(zk, 0), news.get(zi, 0))
            assert found == expected, (lines, higher, news)
            assert not (update & reset).any()
            seen.add((lines, found))
    assert len({lines for lines, _ in seen}) == 17, "the lines of the table"


def test_two_robots_by_hand() -> None:
    """Both bid for task 0 and the second is outbid; then it can only take task 1. The best
    would be 9 + 8."""
    values = np.array([[10, 9], [8, 1]])
    for outcome in (
        cbba(SingleTask(values), network.complete(2)),
        cbaa(values, network.complete(2)),
    ):
        assert outcome.paths == ((0,), (1,))
        assert outcome.winners == (0, 1)
        assert (outcome.rounds, outcome.messages) == (2, 4)
        assert check(values, outcome) == 11
        assert best(values) == 17


def test_a_line_of_three_by_hand() -> None:
    """The ends want the same task and hear of each other in the second round; the loser's new
    bid needs two more."""
    values = np.array([[9, 2], [0, 0], [8, 3]])
    for outcome in (cbba(SingleTask(values), network.line(3)), cbaa(values, network.line(3))):
        assert outcome.paths == ((0,), (), (1,))
        assert (outcome.rounds, outcome.messages) == (4, 16)


def test_bytes_are_those_of_the_lists() -> None:
    """Two robots, one task, one round each way: bids, winners and times of two robots and none."""
    outcome = cbba(SingleTask(np.array([[5], [4]])), network.complete(2))
    assert outcome.rounds == 1
    assert outcome.bytes == 2 * (1 + 2 + 2 + 4)


@pytest.mark.parametrize("links", NETWORKS.values(), ids=NETWORKS)
@pytest.mark.parametrize("highest", [1000, 3])
@pytest.mark.parametrize("spread", [False, True])
def test_guarantees_of_single_assignment(links, highest: int, spread: bool) -> None:  # type: ignore[no-untyped-def]
    """Conflict-free, at least half the optimum, as soon as promised; CBAA as good as CBBA."""
    for seed in range(12):
        values = random_values(seed, highest)
        reach = links(len(values))
        diameter = int(network.distances(reach).max())
        for outcome in (
            cbba(SingleTask(values), reach, spread=spread),
            cbaa(values, reach, spread=spread),
        ):
            assert 2 * check(values, outcome) >= best(values), f"seed {seed}"
            assert outcome.rounds <= min(values.shape) * diameter, f"seed {seed}"
            if not spread:
                greedy = sequential_greedy(values)
                paths = {r: path[0] for r, path in enumerate(outcome.paths) if path}
                assert paths == greedy, f"seed {seed}: not what sequential greedy finds"


def tours(seed: int) -> DiscountedTours:
    chance = np.random.default_rng(seed)
    return DiscountedTours(
        chance.random((3, 2)), chance.random((4, 2)), chance.uniform(1, 5, 4).tolist(), 0.4, 3
    )


def best_tours(scoring: DiscountedTours) -> int:
    """Brute force over all ways to give four tasks to three robots or to nobody, and orders."""
    found = 0
    for owners in product(range(scoring.robots + 1), repeat=scoring.tasks):
        worth = 0
        for robot in range(scoring.robots):
            mine = [task for task, owner in enumerate(owners) if owner == robot]
            if len(mine) > scoring.bundle_size:
                break
            worth += max(scoring.score(robot, path) for path in permutations(mine))
        else:
            found = max(found, worth)
    return found


@pytest.mark.parametrize("links", NETWORKS.values(), ids=NETWORKS)
def test_guarantees_of_bundles(links) -> None:  # type: ignore[no-untyped-def]
    longest = 0
    for seed in range(15):
        scoring = tours(seed)
        reach = links(scoring.robots)
        outcome = cbba(scoring, reach)
        taken = sorted(task for path in outcome.paths for task in path)
        assert taken == list(range(scoring.tasks)), f"seed {seed}: a task is free or taken twice"
        for robot, path in enumerate(outcome.paths):
            assert all(outcome.winners[task] == robot for task in path), f"seed {seed}"
        worth = sum(scoring.score(robot, path) for robot, path in enumerate(outcome.paths))
        assert 2 * worth >= best_tours(scoring), f"seed {seed}"
        bound = scoring.tasks * int(network.distances(reach).max())
        assert outcome.rounds <= bound, f"seed {seed}"
        longest = max(longest, *map(len, outcome.paths))
    assert longest > 1, "no bundle was ever longer than one task"


def test_gains_of_tours_diminish() -> None:
    for seed in range(20):
        scoring = tours(seed)
        for robot, (first, second) in product(range(3), permutations(range(4), 2)):
            alone, _ = scoring.gains(robot, [])
            after, _ = scoring.gains(robot, [first])
            assert after[second] <= alone[second] + 2, f"seed {seed}"  # rounded twice


def test_a_bundle_by_hand() -> None:
    """On a line: robot 0 at 0, robot 1 at 10; tasks at 1, 2 and 9. Each serves its side."""
    scoring: Scoring = DiscountedTours(
        np.array([[0.0, 0], [10, 0]]), np.array([[1.0, 0], [2, 0], [9, 0]]), [1, 1, 1], 0.9, 2
    )
    outcome = cbba(scoring, network.complete(2))
    assert outcome.paths == ((0, 1), (2,))


def test_losing_a_task_releases_what_came_after_it() -> None:
    """Both begin with task 0, the nearest; who loses it bids anew for the rest, from its place."""
    scoring = DiscountedTours(
        np.array([[0.0, 0], [0, 1]]), np.array([[0.5, 0], [0, 2.0]]), [5, 1], 0.5, 2
    )
    outcome = cbba(scoring, network.complete(2))
    assert outcome.paths == ((0,), (1,))
    # Robot 1 first bid for task 1 with the way from task 0, and after it with its own.
    alone, _ = scoring.gains(1, [])
    after_task_0, _ = scoring.gains(1, [0])
    assert 0 < after_task_0[1] < alone[1]


def test_equal_bids_go_to_the_lower_number_whoever_asks_first() -> None:
    values = np.ones((4, 2), dtype=np.int64)
    for links in NETWORKS.values():
        for outcome in (cbba(SingleTask(values), links(4)), cbaa(values, links(4))):
            assert outcome.paths == ((0,), (1,), (), ())


def test_a_robot_without_neighbours_in_a_team_of_one() -> None:
    outcome = cbba(SingleTask(np.array([[3, 4]])), network.complete(1))
    assert (outcome.paths, outcome.rounds, outcome.messages) == (((1,),), 0, 0)


def test_networks() -> None:
    assert network.distances(network.line(5)).max() == 4
    assert network.distances(network.ring(5)).max() == 2
    assert network.distances(network.complete(5)).max() == 1
    assert network.ring(2).sum() == 2
    for seed in range(10):
        links = network.random(9, seed)
        assert (links == links.T).all()
        assert not links.diagonal().any()
        network.distances(links)
    with pytest.raises(ValueError, match="not connected"):
        network.distances(np.zeros((2, 2), dtype=np.bool_))


def test_flooding_by_hand() -> None:
    sizes = np.array([10, 20, 30])
    assert network.flooding(network.complete(3), sizes) == (1, 6, 120)
    # On a line the ends send their own and then nothing new; the middle its own, then both ends'.
    assert network.flooding(network.line(3), sizes) == (2, 8, 10 + 30 + 2 * 60 + 20 + 20)


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
    links = network.complete(2)
    greedy = plain.choice(cbba(SingleTask(plain.values), links))
    assert greedy.tolist() == [0, 0]
    verdict = judge(instance, greedy)
    assert (verdict.score, verdict.usable, verdict.missed) == (17, 17, 1)
    kept = with_bonus.choice(cbba(SingleTask(with_bonus.values), links))
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
            outcome = cbba(SingleTask(tasks.values), network.complete(12), spread=True)
            check(tasks.values, outcome)
            judge(instance, tasks.choice(outcome))
