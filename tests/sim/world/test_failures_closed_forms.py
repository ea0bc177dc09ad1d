"""Simulated frequencies and durations against closed forms for trees of actions.

Source: Colledanchise and Ögren, Behavior Trees in Robotics and AI, chapter on stochastic
behavior trees, and their "How Behavior Trees Modularize Hybrid Control Systems". Action i succeeds
with probability p_i, and takes a time of mean t_i whichever way it ends. Then, with one robot,

    Sequence:  P = prod p_i,            E[T] = sum_i t_i prod_(j<i) p_j
    Fallback:  P = 1 - prod (1 - p_i),  E[T] = sum_i t_i prod_(j<i) (1 - p_j)

and a nested tree is an action with the P of its own, and conditional means. A robot that is alone
needs no time to agree with anybody, so a run takes what its actions take.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from statistics import fmean, stdev
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, build_tree
from mrbt_mesh.core.mission.mission import (
    MICRO,
    GlobalTask,
    LocalTask,
    Mission,
    Need,
    Robot,
)
from mrbt_mesh.sim import simulate
from mrbt_mesh.sim.world.setup import FailureModel
from tests.support.effort import at_size

RUNS = at_size(quick=100, gate=400)
# What a run needs beside its actions: rounding, one message of the robot to itself.
OVERHEAD_S = 1e-3
CHANCES = {"a": 0.9, "b": 0.6, "c": 0.75}
MEANS_S = {"a": 1.0, "b": 2.5, "c": 0.5}

fixed = RobotProgram()


@fixed.local_task("*")
async def take_fixed_time(task: TaskContext) -> None:
    await anyio.sleep(task.simulation.work)


exponential = RobotProgram()


@exponential.local_task("*")
async def take_exponential_time(task: TaskContext) -> None:
    """The same for the same activation: it names the run, which names the seed."""
    await anyio.sleep(random.Random(task.activation).expovariate(1 / task.simulation.work))


def mission_of(tree: NodeSpec) -> Mission:
    names = sorted(CHANCES)
    capabilities = dict.fromkeys(names, MICRO)
    return Mission(
        name="closed",
        robots={"R": Robot("R", "all", capabilities)},
        robot_types={"all": capabilities},
        local_tasks={n: LocalTask(n, (), round(MEANS_S[n] * MICRO)) for n in names},
        conditions={},
        global_tasks={n: GlobalTask(n, (Need(n, 1, 1),)) for n in names},
        tree=build_tree(tree),
    )


def action(name: str) -> NodeSpec:
    return NodeSpec(Kind.ACTION, subject=name)


def node(kind: Kind, *children: NodeSpec | str) -> NodeSpec:
    made = (action(child) if isinstance(child, str) else child for child in children)
    return NodeSpec(kind, tuple(made))


SEQUENCE, FALLBACK = Kind.SEQUENCE, Kind.FALLBACK
TREES = {
    "sequence": node(SEQUENCE, "a", "b", "c"),
    "fallback": node(FALLBACK, "b", "c", "a"),
    "fallback in a sequence": node(SEQUENCE, "a", node(FALLBACK, "b", "c")),
    "sequence in a fallback": node(FALLBACK, node(SEQUENCE, "a", "b"), "c"),
}


def closed_form(tree: NodeSpec) -> tuple[float, float]:
    """(probability of success, mean duration in s) by the formulas above.

    The next child of a Sequence is reached with the probability that all before have succeeded;
    E[T] needs no conditional means, since a child's whole mean counts whenever it is reached.
    """
    if tree.kind is Kind.ACTION:
        return CHANCES[tree.subject], MEANS_S[tree.subject]
    reached, mean_s = 1.0, 0.0
    for child in tree.children:
        chance, takes_s = closed_form(child)
        mean_s += reached * takes_s
        reached *= chance if tree.kind is SEQUENCE else 1 - chance
    return (reached if tree.kind is SEQUENCE else 1 - reached), mean_s


def binomial_interval(runs: int, chance: float, outside: float = 1e-4) -> tuple[int, int]:
    """The smallest and largest number of successes that leave out half of `outside` each."""
    masses = [math.comb(runs, k) * chance**k * (1 - chance) ** (runs - k) for k in range(runs + 1)]
    low = high = 0
    total = 0.0
    for k, mass in enumerate(masses):
        if total + mass <= outside / 2:
            low = k + 1
        total += mass
        if total < 1 - outside / 2:
            high = k + 1
    return low, high


def outcomes(tree: NodeSpec, program: RobotProgram, chances: Mapping[str, float]) -> list[Any]:
    mission, model = mission_of(tree), FailureModel(actions=chances)
    return [
        simulate(mission, program, seed=seed, failures=model, inspect=False) for seed in range(RUNS)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", TREES)
@pytest.mark.parametrize("program", [fixed, exponential], ids=["fixed", "exponential"])
def test_success_and_duration_are_those_of_the_closed_form(
    name: str, program: RobotProgram
) -> None:
    tree = TREES[name]
    found = outcomes(tree, program, {n: 1 - chance for n, chance in CHANCES.items()})
    chance, mean_s = closed_form(tree)
    low, high = binomial_interval(RUNS, chance)
    successes = sum(result.result == "success" for result in found)
    assert {result.result for result in found} == {"success", "failure"}
    assert low <= successes <= high, f"{successes} of {RUNS} seeds, expected {chance:.3f}"
    durations_s = [result.summary["duration_s"] for result in found]
    # 99.99 % of a normal distribution lie within 3.891 standard errors of its mean.
    error_s = 3.891 * stdev(durations_s) / math.sqrt(RUNS)
    assert abs(fmean(durations_s) - mean_s) < error_s + OVERHEAD_S


def test_with_certainty_a_run_takes_what_its_actions_take() -> None:
    mission = mission_of(TREES["sequence"])
    result = simulate(mission, fixed, seed=1)
    assert result.result == "success"
    assert 0 <= result.summary["duration_s"] - sum(MEANS_S.values()) < OVERHEAD_S


def test_the_binomial_interval_is_exact() -> None:
    """Against sums over small cases, and the symmetric one."""
    assert binomial_interval(10, 0.5, outside=0.05) == (2, 8)
    assert binomial_interval(10, 0.5, outside=0.001) == (1, 9) or binomial_interval(
        10, 0.5, outside=0.001
    ) == (0, 10)
    low, high = binomial_interval(400, 0.405)
    assert 0 < low < 162 < high < 400
