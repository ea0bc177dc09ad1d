"""One definition of what faults do to a mission: what `mrbt analyze` foretells, what follows from
ticks of the tree alone, and what a team of agents then does, over random missions with conditions.

`make tolerance` compares some 6,200 runs.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from unittest import mock

import pytest

from mrbt_mesh.analysis.tolerance.bound import is_done_before
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.planning import make_plan
from tests.support.effort import at_size
from tests.support.tolerance_cases import (
    Case,
    cases,
    foreseen,
    foreseen_of_all,
    simulated,
    survives,
    with_fixed_conditions,
)

pytestmark = pytest.mark.timeout(600)

MISSIONS = at_size(quick=20, gate=100, long=1_800)
BLOCK = 20
RESULTS = {Status.SUCCESS: "success", Status.FAILURE: "failure", Status.RUNNING: "blocked"}


def check(case: Case) -> Status:
    """One run, foretold in two ways; what came of it."""
    expected = foreseen(case)
    foretold = survives(with_fixed_conditions(case.mission), case.faults)
    assert foretold is (expected is Status.SUCCESS), case
    assert simulated(case) == RESULTS[expected], case
    return expected


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, MISSIONS, BLOCK))
def test_runs_end_as_analysis_and_the_tree_foretell(first: int) -> None:
    """For each choice of conditions alone, and what analysis says of all of them together."""
    done: Counter[Status] = Counter()
    for seed in range(first, min(MISSIONS, first + BLOCK)):
        found = list(cases(seed))
        ended = [check(case) for case in found]
        done.update(ended)
        succeeds = [
            status is Status.SUCCESS
            for case, status in zip(found, ended, strict=True)
            if case.is_possible
        ]
        if found[0].are_distinct and succeeds:
            assert survives(found[0].mission, found[0].faults) is all(succeeds), found[0]
    assert len(done) == len(RESULTS), "every result comes up"


def unbound(case: Case) -> Case:
    """The same without `same_robot_as`."""
    tasks = {
        name: replace(task, needs=tuple(replace(n, same_robot_as=None) for n in task.needs))
        for name, task in case.mission.global_tasks.items()
    }
    return replace(case, mission=replace(case.mission, global_tasks=tasks))


TIMES_US = (100_000, 1_500_000, 2_500_000)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, MISSIONS, BLOCK))
def test_tasks_for_the_robots_that_did_another_one(first: int) -> None:
    """Whichever robots those are, and whenever the faults happen."""
    found: Counter[tuple[bool, bool]] = Counter()
    for seed in range(first, min(MISSIONS, first + BLOCK)):
        for case in cases(seed, is_bound=True):
            tasks = [case.mission.global_tasks[n.subject] for n in case.mission.tree.actions()]
            bound = [(task.id, need) for task in tasks for need in task.needs if need.same_robot_as]
            if not bound:
                continue
            foretold = survives(with_fixed_conditions(case.mission), case.faults)
            by_ticks = foreseen_of_all(case) is Status.SUCCESS
            ways = [(at_us, number) for at_us in TIMES_US for number in range(2)]
            runs = {way: simulated(case, *way) for way in ways}
            # Later faults may block what earlier ones let fail, also where nobody is bound.
            bad = {way for way, result in runs.items() if result != "success"}
            if foretold:
                bad = {way for way in bad if simulated(unbound(case), *way) == "success"}
            # Where the tree need not reach the first task, the second one counts as infeasible.
            is_certain = all(is_done_before(case.mission.tree, n, task) for task, n in bound)
            assert foretold is by_ticks if is_certain else foretold <= by_ticks, case
            assert not (foretold and bad), (case, runs)
            found[foretold, not bad] += 1
    assert found[True, True], "some are survived"
    assert found[False, False] > found[False, True], "most of the others are not"


@pytest.mark.parametrize("seed", [15, 86])
def test_a_team_that_waits_for_the_dead_is_found_out(seed: int) -> None:
    differing = [case for case in cases(seed) if not _agrees(case)]
    assert differing == []
    with mock.patch.object(make_plan, "pending_failures", return_value={}):
        differing = [case for case in cases(seed) if not _agrees(case)]
    assert differing


def _agrees(case: Case) -> bool:
    return simulated(case) == RESULTS[foreseen(case)]
