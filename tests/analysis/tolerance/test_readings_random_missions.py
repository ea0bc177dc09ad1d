"""300 random missions: models and counting everything agree."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from mrbt_mesh.analysis.tolerance.advice import advise, enlarged
from mrbt_mesh.analysis.tolerance.fault_counts import Reading, tolerance
from mrbt_mesh.analysis.tolerance.readings import every_task, parallel_width, serial
from mrbt_mesh.analysis.tolerance.service import Fault, FaultyTeam, capability_faults, robot_faults
from mrbt_mesh.core.mission.mission import Costs, Mission
from tests.support import brute

SEEDS = range(300)
LIMIT_S = 60.0  # never reached: what the tests compare is proved


def kinds_of(mission: Mission) -> list[list[Fault]]:
    return [robot_faults(mission), capability_faults(mission)]


def check(reading: Reading, survives: Callable[[frozenset[Fault]], bool], seed: int) -> None:
    """One reading against counting every set of faults."""
    for faults in kinds_of(reading.mission):
        most, fewest, critical = brute.count_everything(faults, survives)
        found = tolerance(reading, faults, LIMIT_S)
        assert found.max_tolerated.is_proved, seed
        assert found.min_fatal.is_proved, seed
        assert found.max_tolerated.value == most, seed
        assert found.min_fatal.value == fewest, seed
        assert list(found.critical) == critical, seed
        if most is not None:
            assert len(found.max_tolerated.chosen) == most, seed
            assert survives(frozenset(found.max_tolerated.chosen)), seed
        if fewest:
            assert len(found.min_fatal.chosen) == fewest, seed
            assert not survives(frozenset(found.min_fatal.chosen)), seed


@pytest.mark.parametrize("seed", SEEDS)
def test_everything_agrees_with_counting_every_set_of_faults(seed: int) -> None:
    mission = brute.random_mission(seed)
    reading = serial(mission).reading
    survives = brute.survivor(mission)
    check(reading, survives, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_the_other_readings_agree_as_well(seed: int) -> None:
    mission = brute.random_mission(seed)
    for reading in (every_task(mission).reading, parallel_width(mission).reading):
        is_possible = bool(reading.services)

        def survives(
            faults: frozenset[Fault], reading: Reading = reading, is_possible: bool = is_possible
        ) -> bool:
            is_possible = is_possible and not faults.issuperset(mission.robots)
            return is_possible and all(
                brute.can_serve(mission, each.tasks, faults) for each in reading.services
            )

        if is_possible:
            check(reading, survives, seed)


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.parametrize("is_strong", [False, True])
def test_advice_is_the_cheapest_that_helps(seed: int, is_strong: bool) -> None:
    """All additions up to three parts are tried; none that is cheaper makes the team tolerant."""
    mission = brute.random_mission(seed)
    reading = serial(mission).reading
    costs = Costs({"T": 3, "S": 2}, {"l0": 1, "l1": 2})
    found = advise(reading, is_strong, costs, LIMIT_S)

    def is_tolerant(team: Mission) -> bool:
        survives = brute.survivor(team)
        faults = robot_faults(team) if is_strong else capability_faults(team)
        return survives(frozenset()) and all(survives(frozenset({fault})) for fault in faults)

    if found.cost is not None:
        assert is_tolerant(enlarged(mission, found.robots, found.capabilities)), seed
    names = sorted(
        {
            need.local_task.partition("(")[0]
            for t in mission.global_tasks.values()
            for need in t.needs
        }
    )
    parts = [("robot", kind) for kind in mission.robot_types] + [
        ("capability", (robot.id, name))
        for robot in mission.robots.values()
        for name in names
        if name not in robot.capabilities
    ]
    for size in range(4):
        for chosen in itertools.combinations_with_replacement(parts, size):
            robots = {
                kind: count
                for kind in mission.robot_types
                if (count := chosen.count(("robot", kind)))
            }
            extra = [what for part, what in chosen if part == "capability"]
            if len(set(extra)) < len(extra):
                continue
            price = sum(costs.robot(kind) * count for kind, count in robots.items())
            price += sum(costs.capability(name) for _, name in extra)
            if found.cost is None or price < found.cost:
                team = enlarged(mission, robots, extra)
                assert not is_tolerant(team), (seed, robots, extra)


@pytest.mark.parametrize("seed", range(0, 300, 3))
def test_without_time_the_bounds_still_hold_the_figures(seed: int) -> None:
    mission = brute.random_mission(seed)
    reading = serial(mission).reading
    survives = brute.survivor(mission)
    for faults in kinds_of(mission):
        most, fewest, _ = brute.count_everything(faults, survives)
        found = tolerance(reading, faults, 0.0)
        least, bound = found.max_tolerated.value, found.max_tolerated.bound
        if most is None:
            assert least is bound is None, seed
        else:
            assert least is not None, seed
            assert bound is not None, seed
            assert least <= most <= bound, seed
            assert survives(frozenset(found.max_tolerated.chosen)), seed
        if fewest is None:
            assert found.min_fatal.value is None, seed
        else:
            assert found.min_fatal.value is not None, seed
            assert found.min_fatal.bound is not None, seed
            assert found.min_fatal.bound <= fewest <= found.min_fatal.value, seed


def test_slack_is_how_many_robots_a_task_can_lose_whichever_they_are() -> None:
    for seed in SEEDS:
        mission = brute.random_mission(seed)
        team = FaultyTeam(mission)
        for each in every_task(mission).reading.services[:-1]:
            losses = (
                size
                for size in range(len(mission.robots) + 1)
                for lost in itertools.combinations(mission.robots, size)
                if not brute.can_serve(mission, each.tasks, frozenset(lost))
            )
            assert team.slack(each) == next(losses) - 1, (seed, each.name)
