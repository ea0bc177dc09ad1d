"""Random assignment problems: what they promise, and that they never change."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from ortools.graph.python.max_flow import SimpleMaxFlow

from benchmarks.instances import (
    CAPABLE,
    Density,
    Instance,
    Spec,
    Values,
    draw,
    keep_dense,
    keep_sparse,
)

SMALL = [
    Spec(robots, offered, density, values, seed)
    for robots, offered in ((1, 1), (6, 6), (6, 2), (40, 40), (40, 11))
    for density, values, seed in product(Density, Values, (1, 2))
]


def feasible(robots: int, needs: list[tuple[int, list[int]]]) -> bool:
    """By maximum flow: whether each (number, capable robots) can have its own robots."""
    flow = SimpleMaxFlow()
    source, sink = robots + len(needs), robots + len(needs) + 1
    for robot in range(robots):
        flow.add_arc_with_capacity(source, robot, 1)
    for index, (number, capable) in enumerate(needs):
        for robot in capable:
            flow.add_arc_with_capacity(robot, robots + index, 1)
        flow.add_arc_with_capacity(robots + index, sink, number)
    flow.solve(source, sink)
    return bool(flow.optimal_flow() == sum(number for number, _ in needs))


@pytest.mark.parametrize("spec", SMALL, ids=str)
def test_what_an_instance_promises(spec: Spec) -> None:
    found = draw(spec)
    assert np.all(found.lower >= 1)
    assert np.all(found.lower <= np.minimum(found.upper, 3))
    assert np.all(found.upper <= 5)
    keys = found.robot * max(1, found.demands) + found.demand
    assert np.all(np.diff(keys) > 0), "pairs are not sorted, or one is there twice"
    assert found.performance.min(initial=1) >= 1
    assert found.performance.max(initial=1) <= spec.values.highest
    width = spec.robots if spec.density is Density.DENSE else min(CAPABLE, spec.robots)
    counts = np.bincount(found.demand, minlength=found.demands)
    assert counts.tolist() == [width] * found.demands
    needs = [
        (int(found.lower[j]), found.robot[found.demand == j].tolist()) for j in range(found.demands)
    ]
    assert feasible(spec.robots, needs)


def test_the_same_spec_gives_the_same_arrays_and_another_seed_does_not() -> None:
    spec = Spec(20, 20, Density.SPARSE, Values.WIDE, 3)
    first, second, other = (
        draw(spec),
        draw(spec),
        draw(Spec(20, 20, *(spec.density, spec.values), 4)),
    )
    for name in ("lower", "upper", "robot", "demand", "performance"):
        assert np.array_equal(getattr(first, name), getattr(second, name))
    assert not np.array_equal(first.performance, other.performance)


def test_an_instance_stays_what_it_was() -> None:
    """Figures of different days are comparable only if the seeds mean the same."""
    found = draw(Spec(6, 6, Density.SPARSE, Values.NARROW, 1))
    sums = int(found.lower.sum()), int(found.upper.sum()), found.pairs
    values = [1, 8, 9, 9, 5, 5, 5, 2, 9, 10, 10, 10, 1, 9, 7, 6, 2, 5]
    assert (sums, found.performance.tolist()) == ((6, 12, 18), values)


def test_sparse_demands_are_kept_as_one_flow_per_demand_would() -> None:
    refused = 0
    for seed in range(150):
        chance = np.random.default_rng(seed)
        robots, offered = int(chance.integers(1, 9)), int(chance.integers(1, 9))
        lower = chance.integers(0, 4, offered)
        capable = [np.flatnonzero(chance.random(robots) < 0.4) for _ in range(offered)]
        expected: list[int] = []
        for index in range(offered):
            needs = [(int(lower[j]), capable[j].tolist()) for j in [*expected, index]]
            if feasible(robots, needs):
                expected.append(index)
        assert keep_sparse(robots, lower, capable) == expected, f"seed {seed}"
        refused += offered - len(expected)
    assert refused > 100, "the cases tell nothing"


def test_dense_demands_are_kept_while_robots_are_left() -> None:
    assert keep_dense(6, np.array([3, 2, 3, 2, 1, 1])) == [0, 1, 4]


def test_objective_refuses_what_is_no_assignment() -> None:
    instance = Instance(
        2,
        np.array([1, 0]),
        np.array([1, 1]),
        np.array([0, 1, 1]),
        np.array([0, 0, 1]),
        np.array([5, 7, 2]),
    )
    assert instance.objective(np.array([0, 1])) == 7
    assert instance.objective(np.array([-1, 0])) == 7
    for wrong, why in (
        ([-1, 1], "bound"),
        ([0, 0], "bound"),
        ([1, 0], "cannot work"),
        ([0], "fit"),
    ):
        with pytest.raises(ValueError, match=why):
            instance.objective(np.array(wrong))
    assert instance.matrix().tolist() == [[5, 0], [7, 2]]
