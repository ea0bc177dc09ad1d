"""The paper's lemmas on fault tolerance, against the definition and against trying everything."""

from __future__ import annotations

import pytest

from mrbt_mesh.analysis.tolerance.fault_counts import Reading
from mrbt_mesh.analysis.tolerance.readings import serial
from mrbt_mesh.analysis.tolerance.service import Fault, capability_faults, robot_faults
from mrbt_mesh.core.mission.mission import Mission
from paper.lemmas import Verdicts, verdicts
from tests.support import brute
from tests.support.build import action, make_mission, task

SEEDS = range(300)


def kinds_of(mission: Mission) -> list[list[Fault]]:
    return [robot_faults(mission), capability_faults(mission)]


def found_for(reading: Reading, faults: list[Fault]) -> Verdicts:
    return verdicts(reading, faults, reading.critical(faults) if reading.is_feasible else [])


def judged(mission: Mission) -> tuple[Verdicts, Verdicts]:
    """(for minor, for major faults)."""
    reading = serial(mission).reading
    majors, minors = kinds_of(mission)
    return found_for(reading, minors), found_for(reading, majors)


def test_two_that_can_do_both_where_one_is_needed_on_each() -> None:
    """Each stands in for the other only while the other is on the other local task."""
    both = {"l1": 1, "l2": 1}
    mission = make_mission(
        action("g"), {"R1": both, "R2": both}, [task("g", ("l1", 1, 1), ("l2", 1, 1))]
    )
    minor, major = judged(mission)
    assert (major.definition, major.corrected, major.literal) == (False, False, True)
    assert [each.fault for each in major.differences] == ["R1", "R2"]
    assert "other work in g" in major.differences[0].reason
    # One capability lost: the two change places.
    assert (minor.definition, minor.corrected, minor.literal) == (True, True, True)


def test_a_unique_capability_that_no_task_uses() -> None:
    mission = make_mission(action("g"), {"R1": {"g": 1, "sing": 1}, "R2": {"g": 1}})
    minor, major = judged(mission)
    assert (minor.definition, minor.corrected, minor.literal) == (True, True, False)
    assert [each.fault for each in minor.differences] == [("R1", "sing")]
    assert "no task depends on" in minor.differences[0].reason
    assert (major.definition, major.corrected, major.literal) == (True, True, False)


def test_the_lemmas_know_nothing_of_majorities() -> None:
    """Of two robots one cannot grant itself an exclusive task; of three, two can."""
    for count, tolerant in ((2, False), (3, True)):
        robots = {f"R{i}": {"g": 1} for i in range(count)}
        mission = make_mission(action("g"), robots, [task("g", exclusive=True)])
        _, major = judged(mission)
        assert (major.definition, major.corrected, major.literal) == (tolerant, tolerant, True)
        for each in major.differences:
            assert "too few robots are left to grant it" in each.reason


@pytest.mark.parametrize("seed", SEEDS)
def test_the_corrected_lemma_agrees_with_counting(seed: int) -> None:
    mission = brute.random_mission(seed)
    reading, survives = serial(mission).reading, brute.survivor(mission)
    for faults in kinds_of(mission):
        found = found_for(reading, faults)
        tolerant = all(survives(frozenset(each)) for each in ((), *((fault,) for fault in faults)))
        assert found.definition == found.corrected == tolerant, seed


@pytest.mark.parametrize("seed", SEEDS)
def test_the_literal_lemmas_as_by_trying_every_assignment(seed: int) -> None:
    mission = brute.random_mission(seed)
    reading = serial(mission).reading
    for faults in kinds_of(mission):
        found = found_for(reading, faults)
        says = {
            fault: brute.literal_major(mission, fault)
            if isinstance(fault, str)
            else brute.literal_minor(mission, fault)
            for fault in faults
        }
        # With nothing to lose, a robot has stand-ins: nobody.
        expected = reading.is_feasible and all(says.values())
        assert found.literal == expected or not faults, seed
        fatal = set(reading.critical(faults)) if reading.is_feasible else set()
        survived = {fault: reading.is_feasible and fault not in fatal for fault in faults}
        differing = {fault for fault in faults if says[fault] != survived[fault]}
        assert {each.fault for each in found.differences} == differing, seed


def test_the_literal_lemmas_are_wrong_on_some_of_these_missions() -> None:
    """Else the comparison above would show nothing."""
    too_hopeful = too_strict = 0
    for seed in SEEDS:
        mission = brute.random_mission(seed)
        reading = serial(mission).reading
        if not reading.is_feasible:
            continue
        for faults in kinds_of(mission):
            found = found_for(reading, faults)
            too_hopeful += any(each.literal for each in found.differences)
            too_strict += any(each.definition for each in found.differences)
    assert too_hopeful >= 5
    assert too_strict >= 5
